"""What the three commands share: one-line errors, exit codes and ``--help`` with an example."""

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from svfl_data.errors import SvflError

INTERRUPTED = 130  # 128 + SIGINT, the shell's convention


class Parser(argparse.ArgumentParser):
    """Argument parser whose mistakes are one line with exit code 2, and whose help ends with examples."""

    def __init__(self, *, example: str = "", **kwargs: Any) -> None:  # noqa: ANN401 - passed on to argparse
        if example:
            kwargs["epilog"] = "example:\n" + "\n".join(f"  {line}" for line in example.splitlines())
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **kwargs)

    def error(self, message: str) -> NoReturn:
        """Print the mistake and where help is, and exit with 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


Commands = argparse._SubParsersAction  # what `add_subparsers` returns; argparse has no public name
"""The verbs of a command."""


def positive(text: str) -> int:
    """Argument type: an integer of at least 1."""
    return _integer(text, 1)


def natural(text: str) -> int:
    """Argument type: an integer of at least 0."""
    return _integer(text, 0)


def _integer(text: str, least: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer of at least {least}")
    return value


def run(command: Callable[[], None], program: str) -> int:
    """Run a command and turn the user's mistakes into one line.

    Args:
        command: The work to do.
        program: Name to put before the message.

    Returns:
        Exit code: 0, the error's own code, or 130 after Ctrl-C.
    """
    try:
        command()
    except SvflError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"{program}: interrupted; everything finished so far is on disk", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output, such as `head`, has gone
        sys.stderr.close()
        return 0
    return 0
