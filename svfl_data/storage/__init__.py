"""Sealed episode files: writing, examining, judging and reading them."""
