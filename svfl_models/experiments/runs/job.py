"""What a run of an experiment is to the process that does it, and how that process is made ready."""

import os
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from svfl_data.errors import SvflError, TrainingError


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


def devices() -> list[str | None]:
    """Names of the GPUs that this process may use, for the environment of others; [None] if there is none."""
    import torch

    chosen = os.environ.get("CUDA_VISIBLE_DEVICES")
    count = torch.cuda.device_count()
    names = chosen.split(",")[:count] if chosen else [str(index) for index in range(count)]
    return [*names] or [None]


def prepare(devices: Sequence[str | None], log: Path, place: int) -> Callable[[tuple[str, Job]], TrainingError | None]:
    """Make this worker process ready for runs; returns what does one, by its name, and says why it failed.

    Args:
        devices: Names of the machine's GPUs, which the processes take in turns; [None] if there is none.
        log: File that the output of the process is appended to.
        place: Number of the process.
    """
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)  # what libraries print must not tear the parent's progress bar
    os.dup2(descriptor, 2)
    if (device := devices[place % len(devices)]) is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = device  # torch reads it when it starts, so nothing here has imported it
    return _do


def _do(named: tuple[str, Job]) -> TrainingError | None:
    """Do a run; returns why it failed. An error that would befall every run is raised."""
    _, job = named
    try:
        job()
    except TrainingError as error:
        return error
    except SvflError:
        raise
    except Exception as error:  # our own mistake in one run must not cost the others
        traceback.print_exc()
        return TrainingError(f"{type(error).__name__}: {error}".splitlines()[0])
    return None
