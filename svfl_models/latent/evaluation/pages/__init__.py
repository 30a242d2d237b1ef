"""Report of an evaluation: figures, tables and a Markdown page."""
