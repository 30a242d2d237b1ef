"""The report of an evaluation: figures, tables and its page."""
