"""The commands of ``svfl-collect``, one module each: `add` puts it on the command line, `run` does it."""
