"""The commands of ``svfl-train``, one per module: `add` puts it on the command line, `run` does the work."""
