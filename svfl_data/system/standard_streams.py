"""Standard output and error that can always be used, and what to do where they cannot be written."""

import os
import select
import sys
from contextlib import suppress
from typing import TextIO


def prepare() -> None:
    """Write what a terminal's encoding lacks as escapes, and have no standard stream closed.

    A file that is opened while standard output is closed would take its number, and what libraries print would land
    in it.
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
    """Write what is left of standard output; returns why that is impossible, or None."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        _give_up(sys.stdout)
        return error
    return None


def is_reader_gone() -> bool:
    """Whether standard output is a pipe that nobody reads any more.

    `flush_output` says so, too, but not if Python runs unbuffered: then nothing is left to be written.
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
    """Let a stream that cannot be written lead nowhere; Python would try again at its end and fail in more words."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
