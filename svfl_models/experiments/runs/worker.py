"""A process that does one job after the other, on one core or one GPU of its own."""

import multiprocessing
import os
import signal
import threading
import traceback
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Protocol

from svfl_data.errors import SvflError, TrainingError

DYING_S = 5.0


class Job(Protocol):
    """A run that a worker can do: it travels to another process (pickle), and its files tell whether it is finished."""

    @property
    def cost(self) -> float:
        """About how long it takes, compared with the others."""

    def words(self) -> str | None:
        """How it went; None if it is not finished.

        Raises:
            TrainingError: If something else is where its files should be.
        """

    def __call__(self) -> None:
        """Do it, or what is left of it.

        Raises:
            TrainingError: If it fails.
            SvflError: If what has happened would happen to every run, such as a full disk.
        """


class Worker:
    """Such a process, seen from the one that gives it work.

    Args:
        device: Which of the machine's GPUs it sees; None where there is none.
        log: File that its output is appended to.

    Attributes:
        name: Of the run it is at; None if it waits.
    """

    def __init__(self, device: str | None, log: Path) -> None:
        self.name: str | None = None
        # Fresh processes: a forked one would inherit the parent's threads and locks.
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, device, log), daemon=True)
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited: Ctrl-C is the parent's to handle
        try:
            self.process.start()
        finally:
            signal.signal(signal.SIGINT, handler)
        theirs.close()  # now only the process holds it, and its death is the end of the connection

    def begin(self, name: str, job: Job) -> None:
        """Give it a run."""
        self.name = name
        with suppress(OSError):  # it has died; `outcome` tells
            self.connection.send(job)

    def outcome(self) -> SvflError | None:
        """How the run ended: None if well. Waits for it.

        Raises:
            EOFError: If the process died.
        """
        try:
            error: SvflError | None = self.connection.recv()
        except OSError as lost:
            raise EOFError from lost
        self.name = None
        return error

    def exit_code(self) -> int | None:
        """Of one that died; None if it is still at it."""
        self.process.join(DYING_S)  # the connection ends a little before the process
        return self.process.exitcode

    def end(self) -> None:
        """End it, whatever it does; a training ends with its batch, so that no checkpoint is cut in half."""
        self.process.terminate()
        self.process.join(DYING_S)
        self.process.kill()
        self.process.join()
        self.connection.close()


def devices() -> list[str | None]:
    """Names of the GPUs that this process may use, for the environment of others; [None] if there is none."""
    import torch

    chosen = os.environ.get("CUDA_VISIBLE_DEVICES")
    count = torch.cuda.device_count()
    names = chosen.split(",")[:count] if chosen else [str(index) for index in range(count)]
    return [*names] or [None]


def _serve(connection: Connection, device: str | None, log: Path) -> None:
    """Body of the process: runs come in, errors go out, until the parent is gone."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)  # what libraries print must not tear the parent's progress bar
    os.dup2(descriptor, 2)
    if device is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = device  # torch reads it when it starts, so nothing here has imported it
    with suppress(EOFError, KeyboardInterrupt):  # the latter is how Lightning takes `Worker.end`, see `fitting.run`
        while True:
            connection.send(_outcome(connection.recv()))


def _end_with_parent() -> None:
    """Even with one that was killed: its folder is free then, and the next to take it must be alone there."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _outcome(job: Job) -> SvflError | None:
    try:
        job()
    except SvflError as error:
        return error
    except Exception as error:  # our own mistake in one run must not cost the others
        traceback.print_exc()
        return TrainingError(f"{type(error).__name__}: {error}".splitlines()[0])
    return None
