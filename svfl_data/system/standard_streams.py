"""Standard output and standard error that can always be used, and the handling of failed writes to them."""

import os
import select
import sys
from contextlib import suppress
from typing import TextIO


def prepare() -> None:
    """Open the standard streams that are closed, and let output escape the characters that its encoding lacks.

    A closed stream is opened on the null device. Otherwise the next file that is opened would take the number of the
    stream, and what libraries print would be written into that file.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def flush_output() -> OSError | None:
    """Flush standard output, and return the error if that is impossible, else None.

    After such an error, further standard output is discarded.
    """
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        _give_up(sys.stdout)
        return error
    return None


def is_reader_gone() -> bool:
    """Return whether standard output is a pipe that nobody reads any more.

    The result of `flush_output` shows this, too, but not if Python runs unbuffered, because then nothing is left to be
    written.
    """
    output = select.poll()
    output.register(1, 0)
    return any(event & select.POLLERR for _, event in output.poll(0))


def complain(line: str) -> None:
    """Write a line to standard error, if that is possible."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        _give_up(sys.stderr)


def _give_up(stream: TextIO) -> None:
    """Redirect a stream that cannot be written to the null device.

    Otherwise Python would try to write to the stream again at exit, and fail with a longer message.
    """
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
