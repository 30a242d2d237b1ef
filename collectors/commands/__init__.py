"""The commands of ``svfl-collect``, one module each: `add` puts the command on the command line, `run` runs it."""
