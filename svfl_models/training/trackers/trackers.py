"""All trackers of a training together; one that fails is left out and does not end the training."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from svfl_data.errors import TrainingError
from svfl_data.system.printable import printable
from svfl_data.system.standard_streams import complain
from svfl_models.training.trackers.names import check_trackers
from svfl_models.training.trackers.tracker import Tracker

MODULES = {
    "tensorboard": ("tensorboard_events", "TensorBoardEvents"),
    "wandb": ("wandb_run", "WandbRun"),
    "mlflow": ("mlflow_store", "MlflowStore"),
}
"""Module of this folder and class of each tracker, by its name."""


class Trackers:
    """Several trackers as one.

    Args:
        first: Number of optimiser steps that were done before those that Lightning counts.
    """

    def __init__(self, first: int = 0) -> None:
        self.first = first
        self._named: dict[str, Tracker] = {}

    def __bool__(self) -> bool:
        return bool(self._named)

    def add(self, name: str, tracker: Tracker) -> None:
        """Add a tracker under its name."""
        self._named[name] = tracker

    def configuration(self, values: Mapping[str, Any]) -> None:
        """Log the configuration of the training, plain values."""
        self._each(lambda tracker: tracker.configuration(values))

    def numbers(self, values: Mapping[str, float], step: int) -> None:
        """Log numbers by name, after `step` of the optimiser steps that Lightning counts."""
        self._each(lambda tracker: tracker.numbers(values, self.first + step))

    def picture(self, name: str, file: Path) -> None:
        """Log a picture (PNG) or a video (animated GIF)."""
        self._each(lambda tracker: tracker.picture(name, file))

    def close(self, succeeded: bool) -> None:
        """End all runs."""
        self._each(lambda tracker: tracker.close(succeeded))

    def _each(self, act: Callable[[Tracker], None]) -> None:
        for name, tracker in list(self._named.items()):
            try:
                act(tracker)
            except Exception as error:  # a server that is gone, a full disk: the training and its CSV file go on
                del self._named[name]
                complain(f"tracker {name} failed, nothing more is logged to it: {_short(error)}")


NO_TRACKERS = Trackers()


@contextmanager
def opened(names: Sequence[str], out: Path, go_on: bool = False, first: int = 0) -> Iterator[Trackers]:
    """Open trackers that write below a folder, and end their runs with the context.

    Args:
        names: Names of the trackers (`names.TRACKERS`).
        out: Folder of the training.
        go_on: Whether earlier runs of the trackers in this folder are continued, as for a training that is resumed.
        first: Number of optimiser steps that were done before those that Lightning counts.

    Raises:
        UsageError: If a tracker does not exist or its library is not installed.
        TrainingError: If a tracker cannot be opened.
    """
    check_trackers(names)
    trackers, succeeded = Trackers(first), False
    try:
        for name in names:
            trackers.add(name, _opened(name, out, go_on))
        yield trackers
        succeeded = True
    finally:
        trackers.close(succeeded)


def _opened(name: str, out: Path, go_on: bool) -> Tracker:
    module, kind = MODULES[name]
    try:
        tracker: Tracker = getattr(import_module(f"{__package__}.{module}"), kind)(out, go_on)
    except Exception as error:  # each library has errors of its own
        raise TrainingError(f"--logger {name}: cannot be opened below {out}: {_short(error)}") from error
    return tracker


def _short(error: Exception) -> str:
    return printable(" ".join(str(error).split()) or type(error).__name__, 200)
