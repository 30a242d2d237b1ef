"""Checks of the clocks of an episode while it is recorded: time stamps must ascend, and missing readings are reported.

All readers of an episode need ascending time stamps, and a sensor that stopped sending leaves a file that looks whole.
Both faults are reported during the recording, while the robot is still set up, and not weeks later.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from svfl_data.errors import FieldError, UsageError
from svfl_data.schema.clocks import GAP
from svfl_data.schema.rates import FEW, Found, rate_words

Late = Literal["refuse", "drop"]
COVERED = 0.9
"""Smallest share of an episode for which a stream must have readings, apart from declared gaps."""
STOPPED_NS = 1_000_000_000
"""Longest time before the end of the episode at which a stream may stop, [ns]."""
SILENCE_PERIODS, SILENCE_NS = 10, 500_000_000
"""Time without a reading above which a stream counts as silent: so many of its periods, and at least so many [ns]."""


def is_clock(t_ns: np.ndarray) -> bool:
    """Return whether an array with the name ``t_ns`` holds time stamps; below ``extra/`` it may be any array."""
    return t_ns.dtype == np.int64 and t_ns.ndim == 1


@dataclass
class Clock:
    """Summary of the time stamps that one group has so far.

    Attributes:
        count: Number of time stamps.
        first_ns: First time stamp, [ns].
        last_ns: Last time stamp, [ns].
        silences: Start and end of each time of more than `SILENCE_NS` between two readings, [ns].
        dropped: Number of readings that came too late and were left out.
    """

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    silences: list[tuple[int, int]] = field(default_factory=list)
    dropped: int = 0

    def newer(self, group: str, t_ns: np.ndarray, late: Late) -> np.ndarray | None:
        """Return which rows may be appended, because they are newer than all rows before them.

        Args:
            group: Name of the group, for the error message.
            t_ns: Time stamps of the rows, shape (M,), [ns].
            late: What to do with rows that are not newer than all before them: ``refuse`` raises an error, ``drop``
                leaves these rows out.

        Returns:
            Whether each row may be appended, shape (M,), bool. None means all rows, which is the usual case and is
            found quickly.

        Raises:
            FieldError: If a row is not newer and `late` is ``refuse``.
        """
        if not len(t_ns) or ((not self.count or int(t_ns[0]) > self.last_ns) and bool((t_ns[1:] > t_ns[:-1]).all())):
            return None
        least = self.last_ns if self.count else int(t_ns[0]) - 1
        before = np.maximum(least, np.maximum.accumulate(np.concatenate([[least], t_ns[:-1]])))
        newer = t_ns > before
        if late == "refuse":
            row = int(np.argmin(newer))
            raise FieldError(
                f"{group}: row {self.count + row} has t_ns {t_ns[row]}, which is not after the {before[row]} of the "
                "row before; the time stamps of a stream ascend (late='drop' leaves such readings out)"
            )
        return newer

    def take(self, t_ns: np.ndarray) -> None:
        """Count rows that were appended, given by their time stamps, shape (M,), [ns]."""
        if not len(t_ns):
            return
        first, last = int(t_ns[0]), int(t_ns[-1])
        if self.count and first - self.last_ns > SILENCE_NS:
            self.silences.append((self.last_ns, first))
        if last - first > SILENCE_NS:
            rows = np.flatnonzero(np.diff(t_ns) > SILENCE_NS)
            self.silences += zip(t_ns[rows].tolist(), t_ns[rows + 1].tolist(), strict=True)
        self.first_ns = self.first_ns if self.count else first
        self.last_ns = last
        self.count += len(t_ns)

    @property
    def found(self) -> Found:
        """Number, first and last of the time stamps."""
        return Found(self.count, self.first_ns, self.last_ns)

    @property
    def period_ns(self) -> float:
        """Mean interval between readings without silences, [ns]; 0 for fewer than two readings."""
        found, silent = self.found, sum(end - start for start, end in self.silences)
        if found.count - 1 > len(self.silences):
            return (found.last_ns - found.first_ns - silent) / (found.count - 1 - len(self.silences))
        return (found.last_ns - found.first_ns) / max(1, found.count - 1)


@dataclass(frozen=True)
class Gap:
    """A time in which a stream has no readings, as declared by the recording program.

    Attributes:
        stream: Group of the stream, such as ``streams/wrench``.
        start_ns: Start of the gap on the episode clock, [ns].
        end_ns: End of the gap on the episode clock, [ns]; None while the end is not known.
        reason: Reason for the gap, in words.

    Example:
        >>> Gap("streams/wrench", start_ns=1_000_000_000, end_ns=1_200_000_000, reason="loose cable").reason
        'loose cable'
    """

    stream: str
    start_ns: int
    end_ns: int | None
    reason: str

    def __post_init__(self) -> None:
        """Check that times and reason are valid.

        Raises:
            UsageError: If the gap ends before it starts, its times are not integers, or it has no reason.
        """
        times = [self.start_ns] if self.end_ns is None else [self.start_ns, self.end_ns]
        if any(type(time) is not int for time in times) or times != sorted(times):
            raise UsageError(f"{self.stream}: a gap needs integer times in order, got {self.start_ns}, {self.end_ns}")
        if not isinstance(self.reason, str) or not self.reason:
            raise UsageError(f"{self.stream}: a gap needs a reason")

    def annotation(self, start_ns: int, end_ns: int, tool: str) -> dict[str, Any] | None:
        """Return the gap as an annotation that is cut to the time of an episode; None if the gap lies outside.

        Args:
            start_ns: Beginning of the episode, [ns].
            end_ns: End of the episode, [ns].
            tool: Name of the tool that makes the annotation.
        """
        start = max(self.start_ns, start_ns)
        end = end_ns if self.end_ns is None else min(self.end_ns, end_ns)
        if end < start:
            return None
        return {
            "name": GAP, "stream": self.stream, "start_ns": start, "end_ns": end, "reason": self.reason,
            "by": {"tool": tool},
        }  # fmt: skip


def clock_faults(
    clocks: Mapping[str, Clock], span_ns: tuple[int, int], gaps: Sequence[Gap], rates_hz: Mapping[str, float]
) -> Iterator[str]:
    """Yield in words what is wrong with the clocks of an episode that is about to be sealed.

    Args:
        clocks: Clocks by group.
        span_ns: Times of the first and the last observation, [ns].
        gaps: Declared gaps.
        rates_hz: Declared rates by group, [Hz].
    """
    for group in rates_hz.keys() - clocks.keys() - {gap.stream for gap in gaps} - {"actions"}:
        yield f"{group}: {rates_hz[group]:g} Hz was declared, but nothing was appended"
    for group, clock in clocks.items():
        own, declared = [gap for gap in gaps if gap.stream == group], rates_hz.get(group)
        found = _without(clock.found, own)
        rate, cover = rate_words(group, found, declared), _coverage_words(group, clock, span_ns, own, declared)
        slow = declared is not None and found.rate_hz < declared  # perhaps only because of a silence
        if words := (cover or rate) if slow else (rate or cover):
            yield f"{group} {words}"


def _coverage_words(
    group: str, clock: Clock, span_ns: tuple[int, int], gaps: Sequence[Gap], declared_hz: float | None
) -> str | None:
    """Return in words that a stream was silent for too much of an episode; None if it was not.

    Streams that an episode must have, cameras, and streams with a declared rate are watched from the first observation
    on. Other ``streams/`` are watched from their own first reading on. Groups below ``extra/`` without a declared rate
    are not watched, since they may hold rare events.
    """
    (start, end), found = span_ns, clock.found
    needed = declared_hz is not None or group == "streams/wrench" or group.startswith("cameras/")
    watched = group != "observations" and (needed or group.startswith("streams/"))
    if not watched or not found.count or (found.count < FEW and declared_hz is None):
        return None
    start = start if needed else max(start, found.first_ns)
    allowed = max(SILENCE_PERIODS * (1e9 / declared_hz if declared_hz else clock.period_ns), SILENCE_NS)
    times = [(start, found.first_ns), *clock.silences, (found.last_ns, end)]
    inside = ((max(a, start), min(b, end)) for a, b in times)
    silent = [(a, b) for a, b in inside if b - a > allowed]
    missing = sum(_outside(one, gaps) for one in silent)
    if silent and silent[-1][1] == end and (late := _outside(silent[-1], gaps)) > STOPPED_NS:
        return f"stopped {late / 1e9:.2f} s before the end of the episode, and no gap was declared"
    if end > start and missing > (1 - COVERED) * (end - start):
        share = 1 - missing / (end - start)
        return f"has readings of {share:.0%} of the episode ({(end - start) / 1e9:.2f} s), and no gap was declared"
    return None


def _outside(span_ns: tuple[int, int], gaps: Sequence[Gap]) -> int:
    """Return the length of the part of a time span that lies outside of some gaps, [ns]."""
    start, end = span_ns
    left, at = 0, start
    for gap in sorted(gaps, key=lambda gap: gap.start_ns):
        left += max(0, min(gap.start_ns, end) - at)
        at = max(at, min(end if gap.end_ns is None else gap.end_ns, end))
    return left + max(0, end - at)


def _without(found: Found, gaps: Sequence[Gap]) -> Found:
    """Return a summary of time stamps in which declared gaps take no time."""
    length = _outside((found.first_ns, found.last_ns), gaps)
    return Found(found.count, found.first_ns, found.first_ns + length) if gaps else found
