"""What several tests of the data package use."""

import sys

import pytest

from svfl_data.cli import main


@pytest.fixture
def command(monkeypatch, capsys):
    """Run ``svfl-data`` in this process; gives exit code, standard output and standard error."""
    monkeypatch.setenv("CI", "1")  # the command sets it; taken back after the test

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["svfl-data", *map(str, words)])
        try:
            code = main()
        except SystemExit as exit_:  # argparse
            code = exit_.code
        return code, *capsys.readouterr()

    return run
