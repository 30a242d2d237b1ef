"""Linear probes: what a linear regression can read from a feature."""
