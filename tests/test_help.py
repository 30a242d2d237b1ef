"""``--help`` of every command: an example for each, and examples that the command line understands."""

import argparse
import shlex

import pytest

import collectors.cli
import svfl_data.cli
import svfl_models.cli

ROOTS = [module.build_parser() for module in (svfl_data.cli, svfl_models.cli, collectors.cli)]


def parsers(parser, words=()):
    """The parser and its subparsers, by the words that lead to each."""
    yield (*words, parser)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from parsers(below, (*words, name))


COMMANDS = {" ".join((root.prog, *words)): (root, below) for root in ROOTS for *words, below in parsers(root)}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_example_parses(command):
    root, below = COMMANDS[command]
    examples = (below.epilog or "").splitlines()
    assert examples[:1] == ["example:"]
    assert len(examples) > 1
    for line in "\n".join(examples[1:]).replace("\\\n", "").splitlines():
        for command_line in line.partition(" | ")[0].split(" && "):
            program, *words = shlex.split(command_line, comments=True)
            assert program == root.prog
            root.parse_args(words)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_the_terminal(command, monkeypatch):
    """But for the usage, of which argparse breaks no group, and the lines of examples, which are for copying."""
    monkeypatch.setenv("COLUMNS", "80")
    _, _, below = COMMANDS[command][1].format_help().partition("\n\n")
    assert max(map(len, below.partition("example:")[0].splitlines())) <= 80


@pytest.mark.parametrize("port", ["0", "65535", "x"])
def test_ports_exist(port, capsys):
    with pytest.raises(SystemExit, match="2"):
        svfl_data.cli.build_parser().parse_args(["view", "data", "--web", "--port", port])
    assert "not an integer from 1 to 65534" in capsys.readouterr().err
