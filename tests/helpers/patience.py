"""How long tests wait for what should happen at once: beside ten other busy processes it may take minutes."""

PATIENCE = 600.0
"""Seconds after which something is taken to hang. No test passes or fails for being faster than this."""
