"""Running of a command: one-line errors, exit codes, and an orderly end by signals."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from svfl_data.errors import SvflError, UsageError
from svfl_data.system import standard_streams
from svfl_data.system.cache_folder import confine_caches
from svfl_data.system.command_line import completion
from svfl_data.system.command_line.parser import Parser
from svfl_data.system.extras import OURS, needs
from svfl_data.system.printable import LONGEST_LINE, printable
from svfl_data.system.progress import quiet
from svfl_data.system.refused import refusal

SIGNALLED = 128  # exit code of a command that a signal ended, plus the signal's number, as in shells


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
    completion.answer(root)
    return run(lambda: _called(root, words), root.prog)


def _called(root: Parser, words: list[str] | None) -> None:
    arguments = root.parse_args(words)
    name = vars(arguments).pop("command_name")
    confine_caches()
    try:
        with quiet(vars(arguments).pop("quiet", False)):
            arguments.command(arguments)
    except UsageError as error:
        raise UsageError(f"{error} (see {root.prog} {name} --help)") from error
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
