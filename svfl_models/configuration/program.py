"""A program of ``svfl-train`` whose options, help and files are derived from its settings."""

import argparse
import dataclasses
import shlex
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from svfl_data.system.command_line import Commands, Parser
from svfl_data.system.printable import say
from svfl_models.configuration.resolving import complete, resolve
from svfl_models.configuration.setting import UNSET, Setting, settings_of
from svfl_models.configuration.yaml_file import text_of

Values = dict[str, Any]


@dataclass(frozen=True)
class Program:
    """Command with typed settings.

    Attributes:
        name: Name of the command.
        help: One line of help.
        description: Description in the help of the command.
        example: Example command lines for the help.
        settings: Settings that files, ``--set`` and flags can give.
        run: Function that does the work with a value for every setting and with the other options.
        prepare: Function that is called with the settings that are given and with the other options, and returns them
            with those that follow from other options or settings.
    """

    name: str
    help: str
    description: str
    example: str
    settings: tuple[Setting, ...]
    run: Callable[[Values, argparse.Namespace], None]
    prepare: Callable[[Values, argparse.Namespace], Values] = field(default=lambda given, _: given)

    def add(self, commands: Commands) -> Parser:
        """Add the command to the command line, and return its parser, to which further options can be added."""
        parser: Parser = commands.add_parser(
            self.name, help=self.help, description=self.description, example=self.example
        )
        parser.add_argument("--config", type=Path, metavar="FILE",
            help="YAML file with settings, such as --print-config prints or run.yaml of a run; options on the command "
            "line have precedence (default: none)")  # fmt: skip
        parser.add_argument("--set", action="append", default=[], dest="assignments", metavar="NAME=VALUE",
            help="value of any setting, also of those without an option of their own, such as "
            "widths.latent=12; can be given several times (default: none)")  # fmt: skip
        parser.add_argument("--print-config", action="store_true",
            help="print all settings as YAML, with what they mean, and do nothing else (default: not)")  # fmt: skip
        for path, setting in flags_of(self.settings):
            _add_flag(parser, path, setting)
        parser.set_defaults(command=self.start)
        return parser

    def start(self, arguments: argparse.Namespace) -> None:
        """Find the value of each setting, and do the work or, with ``--print-config``, print the settings.

        Args:
            arguments: Options of the command.

        Raises:
            UsageError: If settings are unknown, impossible, missing or contradict each other.
            SvflError: If the work cannot be done.
        """
        options = vars(arguments)
        flags = {path: options.pop(path) for path, _ in flags_of(self.settings) if path in options}
        given = resolve(self.settings, arguments.config, arguments.assignments, flags, self.name)
        given = self.prepare(given, arguments)
        if arguments.print_config:
            known = [one if one.name in given or one.default is not UNSET else _blank(one) for one in self.settings]
            say(*text_of(self.name, complete(known, given), known).splitlines())
            return
        self.run(complete(self.settings, given), arguments)


def command_line(program: str, values: Mapping[str, Any], settings: Sequence[Setting]) -> str:
    """Return the command line that gives a program its settings, without those that have their defaults.

    Args:
        program: Name of the command of ``svfl-train``.
        values: Value of each setting.
        settings: The settings.
    """
    words = ["svfl-train", program]
    for setting in settings:
        value, name = values[setting.name], f"--{setting.name.replace('_', '-')}"
        if value == setting.default or (isinstance(value, list | tuple) and list(value) == setting.default):
            continue
        if isinstance(value, Mapping):
            words += [word for key, one in value.items() for word in ("--set", f"{setting.name}.{key}={_words(one)}")]
        elif isinstance(value, bool):
            words.append(name if value else f"--no-{name[2:]}")
        elif isinstance(value, list | tuple):
            words += [name, *map(str, value)]
        else:
            words += [name, str(value)]
    return shlex.join(words)


def _words(value: object) -> str:
    return f"[{','.join(map(str, value))}]" if isinstance(value, list | tuple) else str(value)


def flags_of(settings: Sequence[Setting], above: str = "") -> list[tuple[str, Setting]]:
    """Return the settings that have an option of their own, each after its path, such as ``hardware.device``."""
    found: list[tuple[str, Setting]] = []
    for setting in settings:
        path, kind = f"{above}{setting.name}", setting.plain_type
        if not setting.flag:
            continue
        if dataclasses.is_dataclass(kind):
            found += flags_of(list(settings_of(typing.cast(type, kind))), f"{path}.")
        elif not setting.inside:
            found.append((path, setting))
    return found


def _add_flag(parser: Parser, path: str, setting: Setting) -> None:
    """Add the option of a setting, which is absent from the result if the user does not give it."""
    name, kind = f"--{setting.name.replace('_', '-')}", setting.plain_type
    help_text = f"{setting.help} ({_default_words(setting)})".replace("%", "%%")
    how: dict[str, Any] = {"dest": path, "default": argparse.SUPPRESS, "help": help_text}
    if kind is bool:
        parser.add_argument(name, action=argparse.BooleanOptionalAction, **how)
        return
    one = setting
    if typing.get_origin(kind) in (list, tuple):
        how["nargs"] = "+"
        one = dataclasses.replace(setting, type=typing.get_args(kind)[0])
    if setting.choices:
        how["choices"] = setting.choices
    if setting.metavar or not setting.choices:
        bare = one.plain_type
        how["metavar"] = setting.metavar or {int: "N", float: "R"}.get(bare, "TEXT")
    parser.add_argument(name, type=_converter(one), **how)


def _converter(setting: Setting) -> Callable[[str], Any]:
    if typing.get_origin(setting.plain_type) is Literal:
        return str  # argparse compares with the choices
    plain = dataclasses.replace(setting, choices=())  # here, too

    def convert(text: str) -> Any:  # noqa: ANN401 - a value of the setting's type
        try:
            return plain.checked(text, strict=False)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return convert


def _default_words(setting: Setting) -> str:
    if setting.default is UNSET:
        return "no default"
    if isinstance(setting.default, list | tuple):
        return f"default: {' '.join(map(str, setting.default)) or 'none'}"
    if isinstance(setting.default, bool):
        return f"default: {'yes' if setting.default else 'no'}"
    return f"default: {'none' if setting.default in (None, '') else setting.default}"


def _blank(setting: Setting) -> Setting:
    """Return a setting that must be given with an empty value, for printing."""
    return dataclasses.replace(setting, default=None)
