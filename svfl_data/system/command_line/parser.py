"""Parser of command lines that reports a mistake in one line: what was meant, and where the help is."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn, cast

from svfl_data.system.command_line.help_text import EXAMPLE, Formatter
from svfl_data.system.command_line.suggestions import DATASET_WORDS, option_instead
from svfl_data.system.near_names import instead
from svfl_data.system.printable import printable

if TYPE_CHECKING:
    _SubParsers = argparse._SubParsersAction["Parser"]  # argparse has no public name for what `add_subparsers` returns
else:
    _SubParsers = argparse._SubParsersAction


class Parser(argparse.ArgumentParser):
    """Argument parser that reports a mistake in one line with exit code 2, and whose help ends with examples.

    Options must be written in full: otherwise ``--episode`` would be taken for ``--episodes`` where only that exists.

    Args:
        example: Command lines that are printed at the end of the help, one per line. No example is printed if it is
            empty.
        **kwargs: Further arguments of `argparse.ArgumentParser`.
    """

    def __init__(self, *, example: str = "", **kwargs: Any) -> None:  # noqa: ANN401 - passed on to argparse
        if example:
            kwargs["epilog"] = EXAMPLE + "\n".join(f"  {line}" for line in example.splitlines())
        super().__init__(formatter_class=Formatter, allow_abbrev=False, **kwargs)
        self.register("action", "parsers", Commands)

    def add_commands(self) -> "Commands":
        """Make this the parser of a program with several commands, and return the object that holds them."""
        self.add_argument("--version", action=Version, help="print the versions of the program and of Python, and exit")
        commands = self.add_subparsers(title="commands", dest="command_name", metavar="COMMAND", required=True)
        return cast(Commands, commands)

    @cached_property
    def output(self) -> argparse._ArgumentGroup:
        """Group of the options that say what a command prints, which end the list of options in the help."""
        return self.add_argument_group("output")

    @property
    def options(self) -> list[str]:
        """All options of this parser, such as ``--episodes``."""
        return [option for action in self._actions for option in action.option_strings]

    @property
    def objects(self) -> list[argparse.Action]:
        """All arguments that stand without an option in front, but for the command."""
        return [one for one in self._actions if not one.option_strings and not isinstance(one, Commands)]

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401 - as argparse has it
        """Parse a command line; words of a command that mean nothing to it are a mistake.

        Args:
            args: Words of the command line. None means those of this process.
            namespace: Object that takes the values. None makes a new one.
        """
        words = sys.argv[1:] if args is None else list(args)
        if self._subparsers:
            self._refuse_unknown_options_before_the_command(words)
        found, left = super().parse_known_args(words, namespace)
        if left:
            self._unexpected(left[0])
        return found, left

    def error(self, message: str) -> NoReturn:
        """Print the mistake and how to get help, and exit with code 2.

        Raises:
            SystemExit: Always.
        """
        self.exit(2, f"{self.prog}: {printable(message, 2000)} (see {self.prog} --help)\n")

    def _print_message(self, message: str, file: Any = None) -> None:  # noqa: ANN401 - as argparse declares it
        """Print help or an error message, and raise an error, unlike argparse, if it cannot be written."""
        if message:
            (file or sys.stderr).write(message)

    def _parse_optional(self, arg_string: str) -> Any:  # noqa: ANN401 - as argparse has it
        """Refuse at once what looks like an option and is none: an option that lacks would be the worse explanation."""
        found = super()._parse_optional(arg_string)
        if found is not None and found[0] is None and not self._subparsers:
            self._unknown_option(arg_string)
        return found

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # noqa: ANN401 - as argparse has it
        if action.choices is None or value in action.choices:
            return
        possible = instead(str(value), [str(one) for one in action.choices])
        if isinstance(action, Commands):
            raise argparse.ArgumentError(None, f"no command {value!r}; {possible}")
        raise argparse.ArgumentError(action, f"no {value!r}; {possible}")

    def _refuse_unknown_options_before_the_command(self, words: Sequence[str]) -> None:
        for word in words:
            if not word.startswith("-"):
                return
            if word not in self._option_string_actions:
                self._unknown_option(word)

    def _unknown_option(self, word: str) -> NoReturn:
        option = word.partition("=")[0]
        if option[1:2].isdigit():
            self.error(f"{word!r} looks like an option; a value that begins with - is written --option={word}")
        hint = option_instead(option, self.options)
        if not hint and self._subparsers:
            hint = "options of a command stand after it"
        elif not hint and option in DATASET_WORDS and self.objects:
            name = self.objects[0].metavar or self.objects[0].dest
            hint = f"{name} stands without an option: {self.prog} {name}"
        self.error(f"no option {option}" + (f"; {hint}" if hint else ""))

    def _unexpected(self, word: str) -> NoReturn:
        hint = f"; did you mean --data {word}?" if "--data" in self.options else ""
        self.error(f"unexpected argument {word!r}{hint}")


class Commands(_SubParsers):
    """Commands of a program: each gets the options that all commands have."""

    def add_parser(self, name: str, **kwargs: Any) -> Parser:  # noqa: ANN401 - passed on to argparse
        """Add a command and return its parser.

        Args:
            name: Name of the command.
            **kwargs: Further arguments of `Parser`, and ``help``, one line for the list of commands.
        """
        parser = super().add_parser(name, **kwargs)
        parser.output.add_argument(
            "--quiet", action="store_true", help="show no progress, only results and errors (default: progress too)"
        )
        return parser


class Version(argparse.Action):
    """Action that prints one line with the versions of the program and of Python, and ends the program."""

    def __init__(self, **kwargs: Any) -> None:  # noqa: ANN401 - passed on to argparse
        super().__init__(nargs=0, default=argparse.SUPPRESS, **kwargs)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the line and exit with code 0."""
        import platform

        import svfl_data

        sys.stdout.write(f"{parser.prog} {svfl_data.__version__}, Python {platform.python_version()}\n")
        parser.exit()


def complete_with(action: argparse.Action, names: Callable[[], Iterable[str]]) -> None:
    """Let shells complete the values of an option, which are then not restricted to these.

    Args:
        action: Option, as `add_argument` has returned it.
        names: Function that returns the values to offer. It is called only when a shell asks.
    """
    action.completer = lambda prefix, **_: [name for name in names() if name.startswith(prefix)]  # type: ignore[attr-defined]
