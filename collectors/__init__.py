"""Collectors: everything that produces episodes."""
