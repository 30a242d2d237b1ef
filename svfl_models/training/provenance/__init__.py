"""Provenance of runs, checkpoints and reports: which code, on which machine, with which data and by which command."""
