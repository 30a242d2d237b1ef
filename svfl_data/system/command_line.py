"""Behaviour that all programs of this software share: one-line errors, exit codes and ``--help`` with an example."""

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
from svfl_data.system import standard_streams
from svfl_data.system.cache_folder import confine_caches
from svfl_data.system.extras import OURS, needs
from svfl_data.system.printable import LONGEST_LINE, printable
from svfl_data.system.refused import refusal

LAST_PORT = 2**16 - 2
SIGNALLED = 128  # exit code of a command that a signal ended, plus the signal's number, as in shells


EXAMPLE = "example:\n"


class _Formatter(argparse.HelpFormatter):
    """Wraps descriptions to the width of the terminal, and leaves the lines of examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLE) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Argument parser that reports a mistake in one line with exit code 2, and whose help ends with examples.

    Args:
        example: Command lines that are printed at the end of the help, one per line. No example is printed if it is
            empty.
        **kwargs: Further arguments of `argparse.ArgumentParser`.
    """

    def __init__(self, *, example: str = "", **kwargs: Any) -> None:  # noqa: ANN401 - passed on to argparse
        if example:
            kwargs["epilog"] = EXAMPLE + "\n".join(f"  {line}" for line in example.splitlines())
        super().__init__(formatter_class=_Formatter, **kwargs)

    def _print_message(self, message: str, file: Any = None) -> None:  # noqa: ANN401 - as argparse declares it
        """Print help or an error message, and raise an error, unlike argparse, if it cannot be written."""
        if message:
            (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        """Print the mistake and how to get help, and exit with code 2.

        Raises:
            SystemExit: Always.
        """
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


Commands = argparse._SubParsersAction  # what `add_subparsers` returns; argparse has no public name
"""Type of the object that holds the commands of a program."""


def positive(text: str) -> int:
    """Parse a command-line argument that must be an integer of at least 1.

    Raises:
        argparse.ArgumentTypeError: If the text is not such an integer.
    """
    return _integer(text, 1)


def port(text: str) -> int:
    """Parse a command-line argument that must be the number of a TCP port, and not the last one.

    Raises:
        argparse.ArgumentTypeError: If the text is not such an integer.
    """
    return _integer(text, 1, LAST_PORT)


def natural(text: str) -> int:
    """Parse a command-line argument that must be an integer of at least 0.

    Raises:
        argparse.ArgumentTypeError: If the text is not such an integer.
    """
    return _integer(text, 0)


def _integer(text: str, least: int, most: int | None = None) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least or (most is not None and value > most):
        possible = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer {possible}")
    return value


def main(root: Parser, words: list[str] | None = None) -> int:
    """Run the command that a command line asks for.

    Args:
        root: Command-line parser of the program. Each command of the parser stores the function to call as `command`,
            and the parser stores the name of the command as `command_name`.
        words: Arguments of the command line, without the name of the program. None means the arguments of this process.

    Returns:
        Exit code, as described in `run`.

    Raises:
        SystemExit: After ``--help``, and with code 2 after a mistake in the command line.
    """
    return run(lambda: _called(root, words), root.prog)


def _called(root: Parser, words: list[str] | None) -> None:
    arguments = root.parse_args(words)
    name = vars(arguments).pop("command_name")
    confine_caches()
    try:
        arguments.command(arguments)
    except ModuleNotFoundError as error:
        if not error.name or error.name.partition(".")[0] in OURS:
            raise
        raise SvflError(f"{name} {needs(error.name)}") from error
    except ImportError as error:  # a library lacks a dependency, or was built for another machine
        raise SvflError(f"{name} cannot load a library: {error}") from error


def run(command: Callable[[], None], program: str) -> int:
    """Run a command, and report the user's mistakes and refusals of the operating system in one line.

    Args:
        command: Function that does the work.
        program: Name of the program, which is printed before the message.

    Returns:
        Exit code: 0 after success and if the reader of standard output has gone, the error's own code after an
        `SvflError`, 128 plus the signal's number after Ctrl-C, SIGTERM or SIGHUP, and 1 after any other error that is
        reported.

    Raises:
        SystemExit: If the command exits by itself, as argparse does after it has printed help or a mistake.
    """
    standard_streams.prepare()
    try:
        with _ended_by_signals():
            command()
    except SvflError as error:
        return _failed(program, str(error), error.exit_code)
    except KeyboardInterrupt as interrupt:
        _failed(program, "interrupted; everything finished so far is on disk")
        return SIGNALLED + (interrupt.number if isinstance(interrupt, Ended) else signal.SIGINT)
    except OSError as error:
        code = _flushed(program)
        if isinstance(error, BrokenPipeError) and standard_streams.is_reader_gone():
            return 0
        return _failed(program, refusal(error)) if code is None else code
    except MemoryError as error:
        return _failed(program, f"not enough memory: {str(error) or 'end other programs, or ask for less at a time'}")
    except UnicodeEncodeError as error:
        words = f"a text cannot be written as {error.encoding}; if it is the name of a file, rename the file"
        return _failed(program, f"{words}: {error.object}")
    except SystemExit:  # argparse has printed help or a mistake
        if code := _flushed(program):
            return code
        raise
    return _flushed(program) or 0


def _flushed(program: str) -> int | None:
    """Flush standard output, and return None if all of it has been written, else the exit code."""
    error = standard_streams.flush_output()
    if error is None:
        return None
    if isinstance(error, BrokenPipeError):  # the reader of our output, such as `head`, has gone
        return 0
    return _failed(program, refusal(error, "standard output"))


def _failed(program: str, message: str, code: int = 1) -> int:
    standard_streams.complain(f"{program}: {printable(message, LONGEST_LINE)}")
    return code


class Ended(KeyboardInterrupt):
    """Interrupt that SIGTERM or SIGHUP raises; code that cleans up after Ctrl-C also cleans up after this interrupt.

    Attributes:
        number: Number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP like Ctrl-C in the block, so that workers, servers and open files end in order.

    A signal that is ignored (nohup) or already has a handler stays as it is, and a forked child is ended as usual.
    """
    own, signals = os.getpid(), (signal.SIGTERM, signal.SIGHUP)

    def end(number: int, _: FrameType | None) -> None:
        if os.getpid() != own:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        raise Ended(number)

    usual = [number for number in signals if signal.getsignal(number) == signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        usual = []  # only the main thread may set signal handlers
    for number in usual:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in usual:
            signal.signal(number, signal.SIG_DFL)
