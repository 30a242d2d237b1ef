"""Whether the time stamps of a stream can be nanoseconds, and whether they come at the rate that was declared."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

RATE_FACTOR = 2.0
"""Between a declared and a found rate at most; beyond it a unit is wrong or a driver does something else."""
FASTEST_HZ = {"observations": 1_000.0, "cameras": 1_000.0, "streams": 50_000.0}
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


def rate_words(group: str, found: Found, declared_hz: float | None = None) -> str | None:
    """What is wrong with a stream's unit of time or rate.

    Args:
        group: Of the stream, such as ``streams/wrench``.
        found: Its time stamps.
        declared_hz: The rate that the recording declared, if it did.

    Returns:
        Words for a person, such as ``comes at 50 Hz, but 500 Hz was declared``; None if nothing is wrong, or if there
        are too few readings to say.
    """
    if found.count and max(abs(found.first_ns), abs(found.last_ns)) > LONGEST_NS:
        days = max(abs(found.first_ns), abs(found.last_ns)) / 86_400e9
        return (
            f"has time stamps {days:.0f} days from the episode's beginning; they must be nanoseconds since the episode "
            "began"
        )
    if found.count < FEW:
        return None
    rate = found.rate_hz
    if declared_hz is not None and not declared_hz / RATE_FACTOR <= rate <= declared_hz * RATE_FACTOR:
        return f"comes at {rate:.4g} Hz, but {declared_hz:.4g} Hz was declared{_unit_words(rate / declared_hz)}"
    if declared_hz is None and rate > FASTEST_HZ.get(group.partition("/")[0], FASTEST_OTHER_HZ):
        return f"comes at {rate:.4g} Hz by its time stamps; they must be nanoseconds, not microseconds or milliseconds"
    return None


def _unit_words(ratio: float) -> str:
    """Which unit explains the ratio between a found and a declared rate."""
    for power, unit in ((3, "microseconds"), (6, "milliseconds"), (9, "seconds")):
        if 10**power / RATE_FACTOR <= ratio <= 10**power * RATE_FACTOR:
            return f"; are its time stamps {unit} instead of nanoseconds?"
    return ""
