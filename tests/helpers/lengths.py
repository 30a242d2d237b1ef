"""Lengths of the episodes in tests of replay."""

LENGTHS = (4, 7, 1, 5)
