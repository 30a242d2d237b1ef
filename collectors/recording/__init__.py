"""Recording loop that all collectors share, with its workers and its display of progress."""
