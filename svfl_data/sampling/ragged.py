"""Streams of many episodes joined end to end, and windows cut from the joined streams for a whole batch at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.schema.clocks import Clock, mean_hz
from svfl_data.schema.input_spec import Window
from svfl_data.schema.rates import DOUBTFUL


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a joined stream that each sample may see: the rows of its own episode up to its own time.

    Row 0 of a joined stream belongs to no episode: it holds zeros and is used where nothing was measured yet.

    Attributes:
        first: First row of each sample's episode, shape (S,), int64.
        fresh: First row after the last break in the stream before each sample
            (`svfl_data.schema.clocks.Clock.first_fresh`), shape (S,), int64.
        end: Row after the last row that each sample may see, shape (S,), int64. Equal to `first` if the sample may
            see no row.
        age: Time from the last row that each sample may see to the sample, shape (S,), float32, [s]. Infinite if the
            sample may see no row.
    """

    first: np.ndarray
    fresh: np.ndarray
    end: np.ndarray
    age: np.ndarray

    def last(self, samples: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the last rows that each sample may see.

        Args:
            samples: Numbers of the samples, shape (B,).
            length: Number of rows for each sample, T.

        Returns:
            Rows, shape (B, T), int64, latest last; and a padding mask of the same shape. The mask is true where the
            episode had no row yet, so that its first row is repeated (or row 0 is used if it had no row at all), and
            where a row is from before a break in the stream.
        """
        first, end = self.first[samples, None], self.end[samples, None]
        rows = end + np.arange(-length, 0)  # (B, T)
        return np.where(rows < first, np.where(end > first, first, 0), rows), rows < self.fresh[samples, None]


@dataclass(frozen=True, eq=False)
class Resampled:
    """Rows of a joined stream that each sample may see, one for each of some evenly spaced moments up to its time.

    Attributes:
        rows: Rows that each sample may see, and the age of the last one (`Rows`).
        t_ns: Time stamps of the joined stream, shape (1 + M,), int64, [ns].
        now_ns: Time of each sample, shape (S,), int64, [ns].
        period_ns: Time between two moments, [ns].
    """

    rows: Rows
    t_ns: np.ndarray
    now_ns: np.ndarray
    period_ns: float

    @property
    def age(self) -> np.ndarray:
        """Time from the last row that each sample may see to the sample, shape (S,), float32, [s]."""
        return self.rows.age

    def last(self, samples: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the latest row at or before each moment, as `Rows.last` does.

        Args:
            samples: Numbers of the samples, shape (B,).
            length: Number of moments, T.
        """
        back_ns = np.round(np.arange(length - 1, -1, -1) * self.period_ns).astype(np.int64)
        moments = self.now_ns[samples, None] - back_ns  # (B, T)
        found = np.empty(moments.shape, np.int64)
        for row, sample in enumerate(samples.tolist()):
            begin, stop = int(self.rows.first[sample]), int(self.rows.end[sample])
            found[row] = begin - 1 + np.searchsorted(self.t_ns[begin:stop], moments[row], side="right")
        first, end = self.rows.first[samples, None], self.rows.end[samples, None]
        padding = found < np.maximum(first, self.rows.fresh[samples, None])
        return np.where(found < first, np.where(end > first, first, 0), found), padding


def rows_of(
    t_ns: Sequence[np.ndarray],
    now_ns: Sequence[np.ndarray],
    known: Sequence[Clock],
    window: Window,
    group: str,
    names: Sequence[object],
) -> Rows | Resampled:
    """Find the rows of a stream that each sample may see, at the rate of a window.

    Args:
        t_ns: Ascending timestamps of the stream in each episode, each of shape (M,), [ns].
        now_ns: Times of the samples in each episode, each of shape (s,), same clock, [ns].
        known: Declared rate and gaps of the stream in each episode.
        window: Window that will be cut, whose rate is compared with that of each episode.
        group: Group of the stream, for the error.
        names: Readers of the episodes, whose ``extent`` names them in the error.

    Raises:
        DatasetError: If a stream has another rate than the window, which is not resampled.
    """
    rows = rows_until(t_ns, now_ns, known)
    if window.rate_hz is None:
        return rows
    rates = [clock.rate_hz or mean_hz(times) for times, clock in zip(t_ns, known, strict=True)]
    for rate, name in zip(rates, names, strict=True):
        if rate and not 1 / DOUBTFUL <= rate / window.rate_hz <= DOUBTFUL and not window.resample:
            where = getattr(name, "extent", name)
            raise DatasetError(
                f"{where}: {group} has {rate:.4g} Hz, but a window of {window.length} readings at {window.rate_hz:.4g} "
                "Hz was asked for; ask for the recorded rate, or resample (Window(..., resample=True))"
            )
    if not window.resample:
        return rows
    return Resampled(rows, join(list(t_ns)), np.concatenate(list(now_ns)), 1e9 / window.rate_hz)


def join(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Join the rows of all episodes after one row of zeros, shape (1 + sum of rows, ...)."""
    return np.concatenate([np.zeros((1, *pieces[0].shape[1:]), pieces[0].dtype), *pieces])


def starts(lengths: Sequence[int]) -> np.ndarray:
    """Return the first row of each episode in a joined stream, shape (E,), int64.

    Args:
        lengths: Number of rows of each episode.
    """
    return np.array(list(accumulate(lengths[:-1], initial=1)), np.int64)


def rows_until(t_ns: Sequence[np.ndarray], now_ns: Sequence[np.ndarray], known: Sequence[Clock]) -> Rows:
    """Find the rows of a stream that each sample may see, none of which is later than the sample.

    Args:
        t_ns: Ascending timestamps of the stream in each episode, each of shape (M,), [ns].
        now_ns: Times of the samples in each episode, each of shape (s,), same clock, [ns].
        known: Declared rate and gaps of the stream in each episode.
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
