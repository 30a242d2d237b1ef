"""Sealed episode files: writing, examining, checking and reading them."""
