"""Table of all arguments of all commands of a program, read from its parser."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from svfl_data.system.command_line.parser import Commands, Parser


@dataclass(frozen=True)
class Option:
    """One argument of one command.

    Attributes:
        program: Name of the program, such as ``svfl-data``.
        command: Name of the command; empty for an option of the program itself.
        name: Option, such as ``--episodes``, or for an argument without an option its name in the help, such as PATH.
        values: What is written after the option, such as ``N`` or ``N [N ...]``; empty for a flag.
        kind: Kind of value: flag, choice, text, Path, or the name of the argument type, such as positive.
        choices: Possible values; empty if there is no list of them.
        required: Whether the command line needs it, perhaps as one of several.
        default: Value without the option; None if there is none.
        help: Help text, in one line.
    """

    program: str
    command: str
    name: str
    values: str
    kind: str
    choices: tuple[str, ...]
    required: bool
    default: Any
    help: str


def commands_of(root: Parser) -> dict[str, Parser]:
    """Return the parsers of all commands of a program by name; the program itself has the empty name."""
    below = [action for action in root._actions if isinstance(action, Commands)]
    return {"": root} | {name: parser for action in below for name, parser in action.choices.items()}


def options_table(root: Parser) -> list[Option]:
    """Return all arguments of all commands of a program, in the order of its help.

    Args:
        root: Parser of the program.
    """
    return [option for command, parser in commands_of(root).items() for option in _options(root.prog, command, parser)]


def _options(program: str, command: str, parser: Parser) -> Iterator[Option]:
    formatter = parser._get_formatter()
    groups = [group for group in parser._mutually_exclusive_groups if group.required]
    for action in parser._actions:
        if isinstance(action, Commands | argparse._HelpAction):
            continue
        placeholder = formatter._get_default_metavar_for_optional(action)
        words = formatter._format_args(action, placeholder) if action.nargs != 0 else ""
        shown = str(action.metavar or action.dest)
        yield Option(
            program=program,
            command=command,
            name=action.option_strings[-1] if action.option_strings else shown,
            values=words,
            kind=_kind(action),
            choices=tuple(map(str, action.choices or ())),
            required=action.required or any(action in group._group_actions for group in groups),
            default=None if action.default is argparse.SUPPRESS else action.default,
            help=" ".join(formatter._expand_help(action).split()) if action.help else "",
        )


def _kind(action: argparse.Action) -> str:
    if action.nargs == 0:
        return "flag"
    if action.choices is not None:
        return "choice"
    return "text" if action.type is None else str(getattr(action.type, "__name__", action.type))
