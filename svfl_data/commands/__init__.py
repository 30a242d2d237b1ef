"""The commands of ``svfl-data``, one module each: `add` puts the command on the command line, and `run` runs it.

Those that write a new dataset lie in `new_datasets`.
"""
