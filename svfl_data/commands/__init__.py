"""The commands of ``svfl-data``, one module each: `add` puts the command on the command line, and `run` runs it."""
