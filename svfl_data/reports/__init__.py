"""Pictures and pages about recorded data."""
