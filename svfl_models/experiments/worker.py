"""A process that trains one network after the other, on one core or one GPU of its own."""

import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from svfl_data.errors import SvflError, TrainingError
from svfl_models.config import TrainingConfig

DYING_S = 5.0
Train = Callable[[TrainingConfig, Path, Path | None], object]
"""Trains one network into a folder: configuration, folder, fresh dataset."""


def train(config: TrainingConfig, out: Path, fresh: Path | None) -> None:
    """Train one network in silence."""
    import torch
    from rich.console import Console

    from svfl_models.train import train_centering

    torch.set_num_threads(1)
    train_centering(config, out, fresh, Console(quiet=True))


class Worker:
    """Such a process, seen from the one that gives it work.

    Args:
        train: What it does; importable, so that a new process finds it.
        fresh: Dataset that every network is tested on besides.
        device: Which of the machine's GPUs it sees; None where there is none.
        log: File that its output is appended to.

    Attributes:
        name: Of the run it is at; None if it waits.
    """

    def __init__(self, train: Train, fresh: Path | None, device: str | None, log: Path) -> None:
        self.device = device
        self.name: str | None = None
        # Fresh processes: a forked one would inherit the parent's threads and locks.
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, train, fresh, device, log), daemon=True)
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited: Ctrl-C is the parent's to handle
        try:
            self.process.start()
        finally:
            signal.signal(signal.SIGINT, handler)
        theirs.close()  # now only the process holds it, and its death is the end of the connection

    def begin(self, name: str, config: TrainingConfig, folder: Path) -> None:
        """Give it a run."""
        self.name = name
        with suppress(OSError):  # it has died; `outcome` tells
            self.connection.send((config, folder))

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
        """End it, whatever it does: an unfinished run leaves nothing that counts, so there is nothing to wait for."""
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


def _serve(connection: Connection, train: Train, fresh: Path | None, device: str | None, log: Path) -> None:
    """Body of the process: runs come in, errors go out, until the parent is gone."""
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)  # what libraries print must not tear the parent's progress bar
    os.dup2(descriptor, 2)
    if device is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = device  # torch reads it when it starts, so nothing here has imported it
    while True:
        try:
            config, folder = connection.recv()
        except EOFError:
            return
        connection.send(_outcome(train, config, folder, fresh))


def _outcome(train: Train, config: TrainingConfig, folder: Path, fresh: Path | None) -> SvflError | None:
    try:
        train(config, folder, fresh)
    except SvflError as error:
        return error
    except Exception as error:  # our own mistake in one run must not cost the others
        traceback.print_exc()
        return TrainingError(f"{type(error).__name__}: {error}".splitlines()[0])
    return None
