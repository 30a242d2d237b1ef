"""Access to the process that examines HDF5 files for this process.

The examiner starts with the first question and ends with the process that asked. `svfl_data.storage.examiner` describes
what the examiner does. Questions are asked one at a time, by any thread. A forked process starts an examiner of its
own.
"""

import atexit
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from svfl_data.errors import StorageError

START_SECONDS, ANSWER_SECONDS = 60.0, 30.0
"""Longest time to wait for the start of the examiner and for an answer, [s]. The examiner itself ends a question that
takes too long before that."""
ANSWER = 2**27
"""Largest size of an answer, in addition to twice the size of the examined content, [bytes]."""
PROGRAM = Path(__file__).with_name("examiner.py")
FEW_THREADS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
NO_PLUGINS = {"HDF5_PLUGIN_PRELOAD": "::"}  # else HDF5 could load foreign filters into the process


class Unanswered(Exception):  # noqa: N818 - an outcome
    """The process that examined a file ended without an answer. The message says how it ended."""


def ask(descriptor: int, question: dict[str, Any]) -> bytes:
    """Have the examiner examine a range of bytes of an open file.

    Args:
        descriptor: Descriptor of the open file. The examiner gets the descriptor itself, not the name of the file.
        question: ``offset`` and ``size`` of the range [bytes], and the arguments of `examiner.examine` (``names`` and
            ``meaning``) or of `examiner.damaged` (``expected``).

    Returns:
        Answer of the examiner, as `examiner.examine` or `examiner.damaged` describes it, in one piece.

    Raises:
        Unanswered: If the file makes HDF5 crash, hang, or take more memory or time than is allowed.
        StorageError: If no examiner can be started.
    """
    global _examiner
    with _lock:
        if _examiner is None:
            _examiner = _Examiner()
        try:
            return _examiner.ask(descriptor, question)
        except BaseException as error:
            if not isinstance(error, Unanswered) or _examiner.lost:
                _examiner.end()  # else the next question would get the answer of this one
                _examiner = None
            raise


class _Examiner:
    """The running examiner program, and the socket that connects this process with it."""

    def __init__(self) -> None:
        self.line, other = socket.socketpair()
        self.lost = False
        try:
            with other:
                self.process = subprocess.Popen(
                    [sys.executable, "-P", str(PROGRAM)], stdin=other.fileno(), stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL, env=os.environ | FEW_THREADS | NO_PLUGINS, start_new_session=True,
                )  # fmt: skip
        except OSError as error:
            self.line.close()
            raise StorageError(f"cannot start {sys.executable} to examine files: {error.strerror}") from error
        try:
            self.line.settimeout(START_SECONDS)
            ready = self.line.recv(1)
        except OSError:
            ready = b""
        if not ready:
            self.end()
            raise StorageError("the program that examines HDF5 files does not start: is h5py installed, memory left?")

    def ask(self, descriptor: int, question: dict[str, Any]) -> bytes:
        """Have a range of bytes of an open file examined; see the function `ask`."""
        reading, writing = os.pipe()
        try:
            try:
                message = json.dumps(question).encode() + b"\n"
                socket.send_fds(self.line, [message], [descriptor, writing])
            finally:
                os.close(writing)
            answer = self._read(reading, ANSWER + 2 * question["size"])
            self.line.settimeout(ANSWER_SECONDS)
            status = self.line.recv(4)
        except OSError as error:
            raise self._lost("the program that examines it ended") from error
        finally:
            os.close(reading)
        if len(status) != 4:
            raise self._lost("the program that examines it ended")
        code = os.waitstatus_to_exitcode(struct.unpack("i", status)[0])
        if code:
            raise Unanswered(_words(code))
        return answer

    def _read(self, pipe: int, limit: int) -> bytes:
        """Read a whole answer: everything that the pipe gives until the process that answers has ended."""
        patience, pieces, size = time.monotonic() + ANSWER_SECONDS, [], 0
        poll = select.poll()
        poll.register(pipe, select.POLLIN)
        poll.register(self.line, select.POLLIN)
        while events := dict(poll.poll(max(0.0, 1000 * (patience - time.monotonic())))):
            if events.get(pipe, 0) & select.POLLIN:
                pieces.append(os.read(pipe, 2**20))
                size += len(pieces[-1])
                if size > limit:
                    raise self._lost("the description of its structure is larger than the file")
            elif self.line.fileno() in events:
                return b"".join(pieces)
            else:  # the pipe is closed; only the end of the process is still to come
                poll.unregister(pipe)
        raise self._lost(f"examining it takes longer than {ANSWER_SECONDS:g} s")

    def _lost(self, why: str) -> Unanswered:
        self.lost = True
        return Unanswered(why)

    def end(self) -> None:
        """End the program; no question may follow."""
        self.line.close()
        self.process.kill()  # safe, since it holds no files or locks that others need
        self.process.wait()


def _words(code: int) -> str:
    if code in (-signal.SIGKILL, -signal.SIGXCPU, -signal.SIGALRM):
        return "reading its structure took too long or too much memory"
    if code < 0:
        return f"reading its structure crashes the HDF5 library ({signal.Signals(-code).name})"
    return "its structure cannot be read"


_lock = threading.Lock()
_examiner: _Examiner | None = None
_inherited: list[_Examiner] = []
"""Examiners of parent processes. They are kept so that nothing waits for a process that is no child of this one."""


def _after_fork() -> None:
    global _examiner, _lock
    _lock = threading.Lock()  # another thread of the parent may have held it
    if _examiner is not None:
        _examiner.line.close()
        _examiner.process.returncode = 0
        _inherited.append(_examiner)
        _examiner = None


def _at_exit() -> None:
    global _examiner
    with _lock:
        if _examiner is not None:
            _examiner.end()
            _examiner = None


os.register_at_fork(after_in_child=_after_fork)
atexit.register(_at_exit)
