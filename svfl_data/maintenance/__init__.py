"""Changing datasets: repair, merge, relabel and pack."""
