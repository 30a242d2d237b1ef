"""Declared facts about the clock of a stream, besides its time stamps: the rate and the gaps.

A rate is declared when recording, ``EpisodeWriter(..., rates_hz={"streams/wrench": 500})``, and is stored in the
configuration of the episode. A gap is declared where a sensor dropped out, as an annotation ``{"name": "gap", "stream":
"streams/wrench", "start_ns": ..., "end_ns": ..., "reason": ...}``. No readings are invented for the time of a gap.
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
"""Name of the annotation that declares a time in which a stream has no readings."""
STALE_PERIODS = 10.0
"""Largest age of a reading, in periods of its stream, up to which the reading still belongs to a moment."""


def mean_hz(t_ns: np.ndarray) -> float:
    """Return the rate of a stream by its mean interval, [Hz]; 0 for fewer than two readings or no time between them.

    Args:
        t_ns: Ascending time stamps of the stream, shape (M,), [ns].
    """
    span = float(t_ns[-1]) - float(t_ns[0]) if len(t_ns) > 1 else 0.0
    return (len(t_ns) - 1) / span * 1e9 if span > 0 else 0.0


def declared_gaps(annotations: Sequence[Any], group: str) -> list[tuple[int, int]]:
    """Return the times in which a stream is declared to have no readings.

    Args:
        annotations: Annotations of the episode (`Meta.annotations`). Those that are not a gap of this stream are
            ignored.
        group: Group of the stream, such as ``streams/wrench``.

    Returns:
        Start and end of each gap, [ns] of the episode clock, ascending.
    """
    return sorted(
        (one["start_ns"], one["end_ns"])
        for one in annotations
        if isinstance(one, Mapping) and one.get("name") == GAP and one.get("stream") == group
        if all(type(one.get(key)) is int and abs(one[key]) <= FARTHEST_NS for key in ("start_ns", "end_ns"))
    )


def without_gaps(t_ns: np.ndarray, gaps: Sequence[tuple[int, int]]) -> Found:
    """Return the summary of the time stamps of a stream, as if declared gaps took no time.

    Args:
        t_ns: Time stamps of the stream, shape (M,), [ns].
        gaps: Start and end of each declared gap of the stream, [ns].
    """
    found = Found.of(t_ns)
    missing = sum(max(0, min(end, found.last_ns) - max(start, found.first_ns)) for start, end in gaps)
    return replace(found, last_ns=found.last_ns - missing)


@dataclass(frozen=True)
class Clock:
    """Declared facts about the clock of a stream in one episode.

    Attributes:
        rate_hz: Declared rate of the stream, [Hz]. None if no rate was declared.
        gaps: Start and end of each time in which the stream is declared to have no readings, [ns], ascending.
    """

    rate_hz: float | None = None
    gaps: tuple[tuple[int, int], ...] = ()

    @classmethod
    def of(cls, meta: Meta, group: str) -> "Clock":
        """Return the declared facts about the clock of a stream.

        Args:
            meta: Metadata of the episode.
            group: Group of the stream, such as ``streams/wrench``.
        """
        return cls(declared_hz(meta.config, group), tuple(declared_gaps(meta.annotations, group)))

    def first_fresh(self, t_ns: np.ndarray, now_ns: np.ndarray) -> np.ndarray:
        """Return the first row of a stream that belongs to each moment: the row after the last break before the moment.

        A stream has a break where it has no reading for more than `STALE_PERIODS` periods, or where a gap was declared.
        Readings from before a break say nothing about the time after the break.

        Args:
            t_ns: Ascending time stamps of the stream, shape (M,), [ns].
            now_ns: Moments, shape (S,), [ns] of the same clock.

        Returns:
            Row of the first reading that belongs to each moment, shape (S,), int64. If no reading belongs to a moment,
            because the latest one lies too far back, the number of readings at or before the moment.
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
        if not broken.any():
            return np.where(stale, ends, 0).astype(np.int64)
        run = np.maximum.accumulate(np.where(np.concatenate([[False], broken]), np.arange(len(t_ns)), 0))
        return np.where(stale, ends, run[latest]).astype(np.int64)

    def _longest_ns(self, t_ns: np.ndarray) -> float:
        """Return the longest interval that is not a break, [ns], which is infinite if the rate is unknown."""
        rate = self.rate_hz or (mean_hz(t_ns) if len(t_ns) >= FEW else 0.0)
        return STALE_PERIODS / rate * 1e9 if rate else math.inf
