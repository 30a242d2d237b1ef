"""The one recording loop, its workers and its display."""
