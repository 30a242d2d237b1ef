"""Whether the time stamps of a stream can be nanoseconds, and whether they come at the rate that was declared."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

DOUBTFUL, RATE_FACTOR = 1.1, 2.0
"""Factor between a declared and a found rate that is worth a warning, and beyond which a unit is wrong or a driver does
something else."""
FASTEST_HZ = {"observations": 4_000.0, "cameras": 4_000.0, "streams": 50_000.0}
"""Rates that can be believed without a declared one, by the first part of a group; `FASTEST_OTHER_HZ` of all others.

Stamps in microseconds make a stream seem 1,000 times as fast as it is, stamps in milliseconds 10^6 times."""
FASTEST_OTHER_HZ = 200_000.0
LONGEST_NS = 7 * 24 * 3600 * 10**9
"""Time of the episode clock that can be believed, [ns]: a week. A clock that began with the epoch shows 50 years."""
FEW = 5
"""Readings below which a rate says nothing."""


@dataclass(frozen=True)
class Found:
    """The time stamps of a stream in short, so that a writer need not keep them.

    Attributes:
        count: How many.
        first_ns: The first, [ns].
        last_ns: The last, [ns].
    """

    count: int
    first_ns: int
    last_ns: int

    @classmethod
    def of(cls, t_ns: np.ndarray) -> "Found":
        """The stamps of a whole stream, shape (M,), [ns]."""
        return cls(len(t_ns), int(t_ns[0]), int(t_ns[-1])) if len(t_ns) else cls(0, 0, 0)

    @property
    def rate_hz(self) -> float:
        """Readings per second by the mean interval; 0 if there is none."""
        span = self.last_ns - self.first_ns
        return (self.count - 1) / span * 1e9 if self.count > 1 and span > 0 else 0.0


def declared_rates(config: Mapping[str, Any]) -> dict[str, float]:
    """The nominal rates that a recording declared, by group such as ``streams/wrench``; [Hz]."""
    rates = config.get("rates_hz")
    if not isinstance(rates, Mapping):
        return {}
    return {str(group): float(rate) for group, rate in rates.items() if isinstance(rate, int | float) and rate > 0}


def declared_hz(config: Mapping[str, Any], group: str) -> float | None:
    """The declared rate of one group, [Hz]; None if there is none."""
    return declared_rates(config).get(group)


def unit_fault(group: str, found: Found) -> str | None:
    """Why the time stamps of a stream cannot be nanoseconds of the episode clock; None if they can be.

    Args:
        group: Of the stream, such as ``streams/wrench``.
        found: Its time stamps.
    """
    if found.count and (farthest := max(abs(found.first_ns), abs(found.last_ns))) > LONGEST_NS:
        return (
            f"has time stamps {farthest / 86_400e9:.0f} days from the episode's beginning; they must be nanoseconds "
            "since the episode began"
        )
    rate = found.rate_hz
    if found.count >= FEW and rate > FASTEST_HZ.get(group.partition("/")[0], FASTEST_OTHER_HZ):
        return f"comes at {rate:.4g} Hz by its time stamps; they must be nanoseconds, not microseconds or milliseconds"
    return None


def rate_fault(found: Found, declared: float | None) -> tuple[Literal["error", "warning"], str] | None:
    """Whether a stream has another rate than declared.

    Args:
        found: Its time stamps, without the time of declared gaps.
        declared: Its declared rate, [Hz]; None if there is none.

    Returns:
        How bad it is, and what is wrong, such as ``comes at 50 Hz, but 500 Hz was declared``; None if the rates agree
        or there are too few readings to say.
    """
    if declared is None or found.count < FEW:
        return None
    rate = found.rate_hz or math.inf
    factor = max(rate / declared, declared / rate)
    if factor <= DOUBTFUL:
        return None
    unit = _unit_words(rate / declared) if factor > RATE_FACTOR else ""
    words = f"comes at {rate:.4g} Hz, but {declared:.4g} Hz was declared{unit}"
    return ("error" if factor > RATE_FACTOR else "warning"), words


def rate_words(group: str, found: Found, declared: float | None = None) -> str | None:
    """What makes the unit of time or the rate of a stream an error; None if nothing does.

    Args:
        group: Of the stream, such as ``streams/wrench``.
        found: Its time stamps, without the time of declared gaps.
        declared: The rate that the recording declared, if it did, [Hz].
    """
    fault = rate_fault(found, declared)
    if fault and fault[0] == "error" and max(abs(found.first_ns), abs(found.last_ns)) <= LONGEST_NS:
        return fault[1]  # names the unit, too
    return unit_fault(group, found)


def _unit_words(ratio: float) -> str:
    """Which unit explains the ratio between a found and a declared rate."""
    for power, unit in ((3, "microseconds"), (6, "milliseconds"), (9, "seconds")):
        if 10**power / RATE_FACTOR <= ratio <= 10**power * RATE_FACTOR:
            return f"; are its time stamps {unit} instead of nanoseconds?"
    return ""
