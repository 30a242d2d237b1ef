"""Showing episodes to a person, in Rerun's viewer or in a file that it opens; importing the package loads no Rerun."""
