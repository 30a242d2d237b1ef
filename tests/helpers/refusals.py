"""Commands whose work raises an error."""

from argparse import _SubParsersAction

import pytest

from collectors.cli import build_parser as collect
from svfl_data.cli import build_parser as data
from svfl_data.system import command_line
from svfl_models.cli import build_parser as train
from tests.helpers.command_lines import COMMANDS, commands_of

PARSERS = {"svfl-data": data, "svfl-train": train, "svfl-collect": collect}
EACH = [(program, command) for program in COMMANDS for command in sorted(commands_of(program))]


def command_parser(program, command):
    """A program's command line and the part of it that is a command's."""
    root = PARSERS[program]()
    (commands,) = (action for action in root._actions if isinstance(action, _SubParsersAction))
    return root, commands.choices[command]


@pytest.fixture
def refused(monkeypatch, tmp_path, capsys):
    """Run a command whose work raises an error; gives exit code and standard error."""

    def run(program, command, error):
        root, parser = command_parser(program, command)

        def work(_):
            raise error

        parser.set_defaults(command=work)
        return command_line.main(root, COMMANDS[program](tmp_path / "data", tmp_path)[command]), capsys.readouterr().err

    return run
