"""Display of a collection's progress: a bar for each dataset on a terminal, and an occasional line elsewhere."""

import time
from types import TracebackType

from rich.progress import TaskID

from collectors.recording.worker import Collected
from svfl_data.system.progress import progress_line
from svfl_data.system.progress.bars import Bars

QUIET_SECONDS = 10.0
"""Least time between two lines of progress where standard error is not a terminal, [s]."""


class CollectionProgress:
    """Display of rate, share of successful attempts and time left, which is used as a context manager."""

    def __init__(self) -> None:
        self._bars = Bars(transient=False)

    def __enter__(self) -> "CollectionProgress":
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def begin(self, task: str, episodes: int, missing: int) -> None:
        """Start the display of a dataset.

        Args:
            task: Name of the dataset's task.
            episodes: Number of episodes that the dataset shall have.
            missing: Number of episodes that the dataset does not have yet.
        """
        self._bar: TaskID = self._bars.add(task, episodes, episodes - missing)
        self._task, self._episodes, self._left = task, episodes, missing
        self._steps = self._successes = self._attempts = self._done = 0
        self._start = self._said = time.monotonic()

    def advance(self, finished: Collected) -> None:
        """Count a finished episode and update the display."""
        self._done += 1
        self._left -= 1
        self._steps += finished.steps
        self._successes += finished.success
        self._attempts += finished.attempts
        now = time.monotonic()
        seconds = max(now - self._start, 1e-3)
        words = f"{self._steps / seconds:.0f} steps/s, {self._successes / self._attempts:.0%} succeed"
        self._bars.update(self._bar, advance=1, words=words)
        if not self._bars.shown and self._left and now - self._said > QUIET_SECONDS:
            self._said = now
            left = self._left * seconds / self._done
            progress_line(f"{self._task}: {self._episodes - self._left}/{self._episodes}, {words}, {left:.0f} s left")
