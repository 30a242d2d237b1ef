"""What a run of an experiment is to the process that does it, and how that process is made ready."""

import os
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from svfl_data.errors import SvflError, TrainingError


class Job(Protocol):
    """A run that a worker process can do.

    A job is pickled to be sent to another process. Whether it is finished is read from its files.
    """

    @property
    def cost(self) -> float:
        """Estimated duration of the run, in arbitrary units that are the same for all runs."""

    def words(self) -> str | None:
        """Return the result of the run in words, or None if the run is not finished.

        Raises:
            TrainingError: If the folder of the run holds something else.
        """

    def __call__(self) -> None:
        """Do the run, or the rest of it if it was interrupted.

        Raises:
            TrainingError: If the run fails.
            SvflError: If an error occurs that would occur in every run, such as a full disk.
        """


def devices() -> list[str | None]:
    """Return the names of the GPUs that this process may use, or [None] if there is no GPU.

    A name is a value for the environment variable ``CUDA_VISIBLE_DEVICES`` of another process.
    """
    import torch

    chosen = os.environ.get("CUDA_VISIBLE_DEVICES")
    count = torch.cuda.device_count()
    names = chosen.split(",")[:count] if chosen else [str(index) for index in range(count)]
    return [*names] or [None]


def prepare(devices: Sequence[str | None], log: Path, place: int) -> Callable[[tuple[str, Job]], TrainingError | None]:
    """Make this worker process ready for runs, and return the function that does one.

    The function takes the name and the job of a run, and returns the error of a run that failed, or None.

    Args:
        devices: Names of the machine's GPUs, which the processes take in turns; [None] if there is none.
        log: File that the output of the process is appended to.
        place: Number of the process.
    """
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)  # output of libraries must not damage the parent's progress bar
    os.dup2(descriptor, 2)
    if (device := devices[place % len(devices)]) is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = device  # must be set before torch is first imported
    return _do


def _do(named: tuple[str, Job]) -> TrainingError | None:
    """Do a run, and return its error, or None. An error that would occur in every run is raised."""
    _, job = named
    try:
        job()
    except TrainingError as error:
        return error
    except SvflError:
        raise
    except Exception as error:  # a bug in one run must not stop the others
        traceback.print_exc()
        return TrainingError(f"{type(error).__name__}: {error}".splitlines()[0])
    return None
