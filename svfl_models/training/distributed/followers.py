"""The processes of a training beside this one: each rebuilds the module and the data, and trains in step."""

import os
import socket
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory

import lightning.pytorch as pl
from torch import distributed

from svfl_data.errors import SvflError, TrainingError
from svfl_data.system.worker_processes import ENDING_S, start_process
from svfl_models.training.distributed.shared_batches import SharedBatches
from svfl_models.training.fitting import Fit

Rebuild = Callable[[], tuple[pl.LightningModule, pl.LightningDataModule]]
"""Builds the module and the data of a training anew, with the same random numbers; it is pickled."""
Follower = tuple[BaseProcess, Connection]
ANSWER_S = 60.0
"""How long this process waits for another one to say why it ended, [s]. On a busy machine it says so late."""


@contextmanager
def followed(fit: Fit, rebuild: Rebuild) -> Iterator[SharedBatches]:
    """Share a training with further processes of this machine for the duration of the context.

    This process is number 0, and the only one that writes files. The others are started fresh (symmetric layers cannot
    be pickled, and PyTorch does not train in a forked process that has trained before), ignore Ctrl-C, and end with the
    context and with this process. They meet through a file and talk over the loopback interface only.

    Args:
        fit: What all processes do alike.
        rebuild: Builds what this process has built; runs in each of the others.

    Yields:
        The strategy of this process, for `fit`.

    Raises:
        StorageError: If a process cannot be started.
        TrainingError: If another process died.
        SvflError: Whatever another process raised.
    """
    others: list[Follower] = []
    with TemporaryDirectory(prefix="svfl_") as folder:
        meeting = Path(folder) / "processes"
        try:
            for rank in range(1, fit.placement.processes):
                others.append(start_process(_follow, fit, rebuild, rank, meeting, parent=True))
            for one in others:
                _expect_ready(one)
            with _joined(fit, 0, meeting) as strategy:
                yield strategy
            for process, _ in others:
                process.join(ENDING_S)
        except RuntimeError as error:  # PyTorch's, if another process is gone
            for one in others:
                _raise_theirs(one, error)
            raise
        finally:
            for process, connection in others:
                process.kill()
                process.join()
                connection.close()


def _follow(connection: Connection, fit: Fit, rebuild: Rebuild, rank: int, meeting: Path) -> None:
    """Body of another process: build, say that it is ready, and train."""
    try:
        fit.placement.use_threads()
        module, data = rebuild()
        connection.send(None)
        with _joined(fit, rank, meeting) as strategy:
            fit(module, data, callbacks=[_Reduced()], strategy=strategy)
    except Exception as error:
        if not isinstance(error, SvflError):  # a mistake of the code, or process 0 is gone
            error = RuntimeError("".join(traceback.format_exception(error)))
        with suppress(OSError):
            connection.send(error)


class _Reduced(pl.Callback):
    """Computes the means of the metrics over all processes when process 0 does, for its metrics file and display."""

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Read the metrics."""
        _ = trainer.callback_metrics


@contextmanager
def _joined(fit: Fit, rank: int, meeting: Path) -> Iterator[SharedBatches]:
    """Belong to the group of processes for the duration of the context."""
    processes = fit.placement.processes
    for library in ("GLOO", "NCCL"):
        os.environ.setdefault(f"{library}_SOCKET_IFNAME", _loopback())
    device = "cuda" if fit.placement.on_gpu else "cpu"
    # A file, because the server that PyTorch would start instead listens on every network interface.
    store = distributed.FileStore(str(meeting), processes)
    backend = distributed.get_default_backend_for_device(device)
    distributed.init_process_group(backend, store=store, rank=rank, world_size=processes)
    try:
        yield SharedBatches(rank, processes)
    finally:
        distributed.destroy_process_group()


def _loopback() -> str:
    """Return the name of the loopback interface."""
    return next((name for _, name in socket.if_nameindex() if name.startswith("lo")), "lo")


def _expect_ready(follower: Follower) -> None:
    """Wait until a process has built the training, and raise what it raised."""
    process, connection = follower
    wait([connection, process.sentinel])
    if (theirs := _received(follower)) is not None:
        raise theirs


def _raise_theirs(follower: Follower, ours: RuntimeError) -> None:
    """Raise what ended another process, if `ours` is only the consequence of its end."""
    theirs = _received(follower) if wait([follower[1]], ANSWER_S) else None
    if isinstance(theirs, SvflError):
        raise theirs from ours
    if theirs is not None:
        ours.add_note(f"another process of the training:\n{theirs}")


def _received(follower: Follower) -> Exception | None:
    """Return what a process has sent: its error, or None if it is ready or has ended in order."""
    process, connection = follower
    try:
        found = connection.recv()
    except (EOFError, OSError):
        process.join(ENDING_S)
        if process.exitcode == 0:
            return None
        return TrainingError("a process of the training died (killed, or out of memory)")
    assert found is None or isinstance(found, Exception)
    return found
