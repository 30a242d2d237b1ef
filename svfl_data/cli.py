"""What the three commands share: one-line errors, exit codes and ``--help`` with an example."""

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

from svfl_data.errors import SvflError

SIGNALLED = 128  # plus the signal: exit code of a command that one has ended, the shell's convention


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
        Exit code: 0, the error's own code, or 128 and the signal's number after Ctrl-C, SIGTERM or SIGHUP.
    """
    try:
        with _ended_by_signals():
            command()
    except SvflError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt as interrupt:
        print(f"{program}: interrupted; everything finished so far is on disk", file=sys.stderr)
        return SIGNALLED + (interrupt.number if isinstance(interrupt, Ended) else signal.SIGINT)
    except BrokenPipeError:  # the reader of our output, such as `head`, has gone
        sys.stderr.close()
        return 0
    return 0


class Ended(KeyboardInterrupt):
    """SIGTERM or SIGHUP asks for the end; wherever Ctrl-C leaves things in order, so does this.

    Attributes:
        number: Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP as Ctrl-C is: workers, servers and open files come to their end with the command.

    A signal that is ignored (nohup) or has a handler already stays as it is, and a forked child is ended as usual.
    """
    own, signals = os.getpid(), (signal.SIGTERM, signal.SIGHUP)

    def end(number: int, _: FrameType | None) -> None:
        if os.getpid() != own:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        raise Ended(number)

    usual = [number for number in signals if signal.getsignal(number) == signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        usual = []  # only the main thread may say what a signal does
    for number in usual:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in usual:
            signal.signal(number, signal.SIG_DFL)
