"""The commands of ``svfl-train``, one module each: `add` puts the command on the command line, `run` runs it."""
