"""Streams of many episodes, joined end to end, and windows cut from them for a whole batch at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.schema.clocks import Clock


@dataclass(frozen=True, eq=False)
class Rows:
    """Which rows of a joined stream each sample may see: those of its own episode, up to its own time.

    Row 0 is no episode's: it is zero and stands for "nothing was measured yet".

    Attributes:
        first: First row of the sample's episode, shape (S,), int64.
        fresh: First row that belongs to the sample's moment (`svfl_data.schema.clocks.first_fresh`), shape (S,), int64.
        end: Row after the last one that the sample may see, shape (S,), int64; `first` if there is none.
        age: Time from that last row to the sample, shape (S,), float32, [s]; infinite if there is none.
    """

    first: np.ndarray
    fresh: np.ndarray
    end: np.ndarray
    age: np.ndarray

    def last(self, samples: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray]:
        """The last rows that samples may see.

        Args:
            samples: Which samples, shape (B,).
            length: How many rows, T.

        Returns:
            Rows, shape (B, T), int64, latest last; and a mask of the same shape, true where the episode had no row
            yet and its first one is repeated (row 0 if it had none at all), and where a row is of another moment.
        """
        first, end = self.first[samples, None], self.end[samples, None]
        rows = end + np.arange(-length, 0)  # (B, T)
        return np.where(rows < first, np.where(end > first, first, 0), rows), rows < self.fresh[samples, None]


def join(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Rows of all episodes after one zero row, shape (1 + sum of rows, ...)."""
    return np.concatenate([np.zeros((1, *pieces[0].shape[1:]), pieces[0].dtype), *pieces])


def starts(lengths: Sequence[int]) -> np.ndarray:
    """First row of each episode in a joined stream, shape (E,), int64."""
    return 1 + np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)


def rows_until(t_ns: Sequence[np.ndarray], now_ns: Sequence[np.ndarray], known: Sequence[Clock]) -> Rows:
    """Which rows each sample may see of a stream with a clock of its own: none from after the sample's time.

    Args:
        t_ns: Ascending timestamps of the stream in each episode, each of shape (M,), [ns].
        now_ns: Times of the samples in each episode, each of shape (s,), same clock, [ns].
        known: What is declared about the clock in each episode.
    """
    first = starts([len(times) for times in t_ns])
    seen, fresh, age = [], [], []
    for times, now, clock in zip(t_ns, now_ns, known, strict=True):
        seen.append(np.searchsorted(times, now, side="right"))
        fresh.append(clock.first_fresh(times, now))
        latest = np.maximum(seen[-1] - 1, 0)
        age.append(np.where(seen[-1] > 0, (now - times[latest]) / 1e9 if len(times) else 0.0, np.inf))
    each = np.repeat(first, [len(now) for now in now_ns])
    first_fresh, end = (each + np.concatenate(found).astype(np.int64) for found in (fresh, seen))
    return Rows(each, first_fresh, end, np.concatenate(age).astype(np.float32))
