"""Work in a forked process."""

import os
from collections.abc import Callable


def fork(work: Callable[[], int]) -> int:
    """Start a process of its own that exits with what `work` returns; 99 if it raises, whatever it raises.

    Whatever happens, the child never goes on with the tests of its parent.
    """
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    return child


def exit_code(child: int) -> int:
    """Wait for a child; its exit code, negative for the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def in_child(work: Callable[[], int]) -> int:
    """Run in a process of its own; its exit code."""
    return exit_code(fork(work))
