"""``--help`` of every command: an example for each, examples that are understood, and lines that fit the terminal."""

import argparse
import io
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


def printed_help(command):
    out = io.StringIO()
    COMMANDS[command][1].print_help(out)
    return out.getvalue()


@pytest.mark.parametrize("columns", ["80", "60", "200"])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_example_of_the_help_is_understood(command, columns, monkeypatch):
    """As printed, where a long example has several lines."""
    monkeypatch.setenv("COLUMNS", columns)
    root, _ = COMMANDS[command]
    _, _, examples = printed_help(command).partition("\nexample:\n")
    lines = [line for line in examples.replace("\\\n", "").splitlines() if not line.strip().startswith("#")]
    assert lines
    for line in lines:
        for command_line in line.partition(" | ")[0].split(" && "):
            program, *words = shlex.split(command_line, comments=True)
            assert program == root.prog
            root.parse_args(words)


@pytest.mark.parametrize("columns", [80, 100])
@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_the_terminal(command, columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert max(map(len, printed_help(command).splitlines())) <= columns


@pytest.mark.parametrize("port", ["0", "65535", "x"])
def test_ports_exist(port, capsys):
    with pytest.raises(SystemExit, match="2"):
        svfl_data.cli.build_parser().parse_args(["view", "data", "--web", "--port", port])
    assert "not an integer from 1 to 65534" in capsys.readouterr().err
