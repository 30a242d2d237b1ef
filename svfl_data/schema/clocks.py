"""What is known about the clock of a stream beside its time stamps: its declared rate, its declared gaps, its unit.

A rate is declared when recording, ``EpisodeWriter(..., rates_hz={"streams/wrench": 500})``, and stands in the episode's
configuration. A gap is declared where a sensor dropped out, as an annotation ``{"name": "gap", "stream":
"streams/wrench", "start_ns": ..., "end_ns": ..., "reason": ...}``: nothing is invented for the time between.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from svfl_data.schema.episode import Meta
from svfl_data.schema.fields import FARTHEST_NS
from svfl_data.schema.rates import FEW, Found, declared_hz

GAP = "gap"
"""Name of the annotation of a time in which a stream has no readings."""
STALE_PERIODS = 10.0
"""A reading that lies farther back than this, in periods of its stream, belongs to another moment."""


def mean_hz(t_ns: np.ndarray) -> float:
    """Rate by the mean interval, [Hz]; 0 for fewer than two readings or no time between them."""
    span = float(t_ns[-1]) - float(t_ns[0]) if len(t_ns) > 1 else 0.0
    return (len(t_ns) - 1) / span * 1e9 if span > 0 else 0.0


def declared_gaps(annotations: Sequence[Any], group: str) -> list[tuple[int, int]]:
    """Times in which a stream is said to have no readings, start and end, [ns], ascending."""
    return sorted(
        (one["start_ns"], one["end_ns"])
        for one in annotations
        if isinstance(one, Mapping) and one.get("name") == GAP and one.get("stream") == group
        if all(type(one.get(key)) is int and abs(one[key]) <= FARTHEST_NS for key in ("start_ns", "end_ns"))
    )


def without_gaps(t_ns: np.ndarray, gaps: Sequence[tuple[int, int]]) -> Found:
    """The time stamps of a stream in short, as if declared gaps took no time.

    Args:
        t_ns: Its time stamps, shape (M,), [ns].
        gaps: Its declared gaps, start and end, [ns].
    """
    found = Found.of(t_ns)
    missing = sum(max(0, min(end, found.last_ns) - max(start, found.first_ns)) for start, end in gaps)
    return replace(found, last_ns=found.last_ns - missing)


@dataclass(frozen=True)
class Clock:
    """What is declared about the clock of a stream in one episode.

    Attributes:
        rate_hz: Its rate, [Hz]; None if none was declared.
        gaps: Times in which it has no readings, start and end, [ns], ascending.
    """

    rate_hz: float | None = None
    gaps: tuple[tuple[int, int], ...] = ()

    @classmethod
    def of(cls, meta: Meta, group: str) -> "Clock":
        """That of a stream such as ``streams/wrench``."""
        return cls(declared_hz(meta.config, group), tuple(declared_gaps(meta.annotations, group)))

    def first_fresh(self, t_ns: np.ndarray, now_ns: np.ndarray) -> np.ndarray:
        """From which row on a stream belongs to a moment: after the last break before it.

        A stream breaks off where it has no reading for more than `STALE_PERIODS` periods, or where a gap was declared;
        readings from before a break say nothing about what comes after it.

        Args:
            t_ns: Ascending time stamps, shape (M,), [ns].
            now_ns: Moments, shape (S,), same clock, [ns].

        Returns:
            Row of the first reading that belongs to each moment, shape (S,), int64; the number of readings at or before
            the moment if there is none, because the latest one lies too far back.
        """
        ends = np.searchsorted(t_ns, now_ns, side="right")
        if not len(t_ns):
            return ends.astype(np.int64)
        longest = self._longest_ns(t_ns)
        latest = np.maximum(ends - 1, 0)
        broken, stale = np.diff(t_ns) > longest, (ends == 0) | (now_ns - t_ns[latest] > longest)
        for start, end in self.gaps:
            broken |= (t_ns[:-1] <= start) & (start < t_ns[1:]) & (start < end)
            stale |= (t_ns[latest] <= start) & (start < now_ns) & (start < end)
        run = np.maximum.accumulate(np.where(np.concatenate([[False], broken]), np.arange(len(t_ns)), 0))
        return np.where(stale, ends, run[latest]).astype(np.int64)

    def _longest_ns(self, t_ns: np.ndarray) -> float:
        """The longest time that is no break, [ns]; infinite where no rate can be told."""
        rate = self.rate_hz or (mean_hz(t_ns) if len(t_ns) >= FEW else 0.0)
        return STALE_PERIODS / rate * 1e9 if rate else math.inf
