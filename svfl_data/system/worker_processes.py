"""Worker processes of this machine, each of which does one job after the other and fails without affecting others."""

import multiprocessing
import os
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

from svfl_data.errors import StorageError, SvflError

Job = TypeVar("Job")
Result = TypeVar("Result")
Prepare = Callable[[int], Callable[[Job], Result]]
"""Is called once in each process with the number of the process's place, 0 .. workers - 1; returns what does a job."""
ENDING_S = 5.0
"""How long a process that was told to end may take before it is killed, [s]."""


@dataclass(frozen=True)
class Died:
    """Stands for the result of a job whose process died.

    Attributes:
        exit_code: Exit code of the process; negative for the signal that killed it.
    """

    exit_code: int | None


def run_jobs(
    prepare: Prepare[Job, Result], waiting: deque[Job], workers: int, finish: bool = True
) -> Iterator[tuple[Job, Result | Died]]:
    """Have worker processes do jobs, and yield each job with its result as soon as it is done.

    The processes are fresh (not forked, for a forked one would inherit the threads and locks of this process), use one
    core each, ignore Ctrl-C, which is for this process to handle, and end when this process ends, however it ends.

    Args:
        prepare: Function that makes the processes ready; it is sent to each, so it must be importable there.
        waiting: Jobs, taken from the left; jobs that are added while results are yielded are done as well.
        workers: Number of processes; no more are started than there are jobs.
        finish: Whether jobs that have begun are finished when the caller stops early or an error ends the iteration.
            Otherwise their processes are terminated.

    Yields:
        Each job with its result, in the order of completion; with `Died` if its process died. A new process takes
        the place of one that died.

    Raises:
        StorageError: If no process can be started.
        Exception: Whatever `prepare` or a job raises.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # read by numerical libraries when a process loads them
    crew: dict[int, _Process[Job, Result]] = {}
    try:
        while waiting or any(one.job for one in crew.values()):
            for place in range(workers):
                if waiting and place not in crew:
                    crew[place] = _Process(prepare, place)
                _begin(crew.get(place), waiting)
            busy = {one.connection: place for place, one in crew.items() if one.job}
            for place in sorted(busy[ready] for ready in wait(list(busy)) if isinstance(ready, Connection)):
                job, outcome = crew[place].outcome()
                if isinstance(outcome, Died):
                    del crew[place]
                _begin(crew.get(place), waiting)  # before the caller does what it does with this result
                yield job, outcome
    except BaseException:
        if not finish:
            for one in crew.values():
                one.process.terminate()
        raise
    finally:
        for one in crew.values():
            one.dismiss()
        for one in crew.values():
            one.join(None if finish else ENDING_S)


def start_process(
    body: Callable[..., None],
    *arguments: Any,  # noqa: ANN401 - passed on to `body`
    parent: bool = False,
) -> tuple[BaseProcess, Connection]:
    """Start a fresh process, which ignores Ctrl-C and ends when this process ends, however it ends.

    Args:
        body: Function that the process calls with its end of a connection to this process, then `arguments`. It must be
            importable in the process.
        arguments: Further arguments of `body`, which are pickled.
        parent: Whether the process may start processes itself. The caller must then end it, because Python waits for
            such a process before this one exits.

    Returns:
        The process and this process's end of the connection, which ends when the process dies.

    Raises:
        StorageError: If no process can be started.
    """
    context = multiprocessing.get_context("spawn")
    handler = None
    if threading.current_thread() is threading.main_thread():
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process inherits it and ignores Ctrl-C at once
    try:
        connection, theirs = context.Pipe()
        process = context.Process(target=_run_body, args=(theirs, body, arguments), daemon=not parent)
        process.start()
    except OSError as error:
        raise StorageError(f"no worker process can be started: {error.strerror or error}") from error
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
    theirs.close()  # now only the process holds this end, and its death is the end of the connection
    return process, connection


def _run_body(connection: Connection, body: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    body(connection, *arguments)


class _Process(Generic[Job, Result]):
    """A worker process, seen from the process that gives it work.

    Attributes:
        job: The job that the process is doing, in a tuple; None while it waits for one.
    """

    def __init__(self, prepare: Prepare[Job, Result], place: int) -> None:
        self.job: tuple[Job] | None = None
        self.process, self.connection = start_process(_serve, prepare, place)

    def begin(self, job: Job) -> None:
        self.job = (job,)
        with suppress(OSError):  # the process has died, which `outcome` tells
            self.connection.send(self.job)

    def outcome(self) -> tuple[Job, Result | Died]:
        """Return the job and its result, or raise what it raised; waits for it."""
        assert self.job is not None
        (job,) = self.job
        try:
            result, error = self.connection.recv()
        except (EOFError, OSError):
            self.process.join(ENDING_S)  # the connection ends a little before the process
            died = Died(self.process.exitcode)
            self.join(ENDING_S)
            return job, died
        self.job = None
        if error is not None:
            raise error
        return job, result

    def dismiss(self) -> None:
        """Tell the process to end after its job."""
        with suppress(OSError):
            self.connection.send(None)

    def join(self, timeout: float | None) -> None:
        """Wait for the end of the process; kill it after `timeout`, [s]."""
        self.process.join(timeout)
        self.process.kill()
        self.process.join()
        self.connection.close()


def _begin(process: _Process[Job, Result] | None, waiting: deque[Job]) -> None:
    """Give a process that waits the next job, if there is one."""
    if process is not None and process.job is None and waiting:
        process.begin(waiting.popleft())


def _serve(connection: Connection, prepare: Prepare[Any, Any], place: int) -> None:
    """Body of a worker process: jobs come in, results go out, until it is dismissed."""
    with suppress(EOFError, KeyboardInterrupt):  # Lightning answers `terminate` with a KeyboardInterrupt
        do, problem = _called(prepare, place)
        while (job := connection.recv()) is not None:
            _answer(connection, *(_called(do, job[0]) if problem is None else (None, problem)))


def _called(function: Callable[[Any], Any], argument: Any) -> tuple[Any, Exception | None]:  # noqa: ANN401 - any job
    """What a function returns, or the error that it raises."""
    try:
        return function(argument), None
    except Exception as error:
        if not isinstance(error, SvflError):  # a mistake of the code: say where it was made
            error.add_note(traceback.format_exc())
        return None, error


def _answer(connection: Connection, result: Any, problem: Exception | None) -> None:  # noqa: ANN401 - any result
    try:
        connection.send((result, problem))
    except (AttributeError, TypeError, ValueError) as error:  # what pickle says of objects that cannot be sent
        connection.send((None, RuntimeError(f"the worker's answer cannot be sent: {error}: {problem or result!r}")))


def _end_with_parent() -> None:
    """End this process with its parent, even with one that was killed: what it worked on is free for the next."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
