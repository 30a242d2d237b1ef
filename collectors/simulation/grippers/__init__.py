"""Simulated grippers."""
