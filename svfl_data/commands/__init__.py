"""The commands of ``svfl-data``, one module each: `add` puts it on the command line, `run` does it."""
