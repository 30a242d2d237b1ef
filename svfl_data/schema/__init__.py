"""Definition of an episode (fields, metadata, clocks, limits) and of the interface between robots and policies.

The only other libraries that this package imports are NumPy and msgspec.
"""
