"""Checks that the time stamps of a stream can be nanoseconds, and that they come at the declared rate."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from svfl_data.errors import UsageError

DOUBTFUL, RATE_FACTOR = 1.1, 2.0
"""Factors between a declared and a found rate. Above the first, the difference causes a warning. Above the second, it
is an error: a unit is wrong, or a driver does something else."""
FASTEST_HZ = {"observations": 4_000.0, "cameras": 4_000.0, "streams": 50_000.0}
"""Largest plausible rate of a stream, [Hz], by the first part of its group.

All other groups have the limit `FASTEST_OTHER_HZ`. Time stamps in microseconds make a stream seem 1,000 times as fast
as it is, time stamps in milliseconds 10^6 times.
"""
FASTEST_OTHER_HZ = 200_000.0
LONGEST_NS = 7 * 24 * 3600 * 10**9
"""Largest plausible time of the episode clock, [ns], which is a week. A clock that began with the Unix epoch
shows 50 years."""
FEW = 5
"""Smallest number of readings from which a rate is measured."""


@dataclass(frozen=True)
class Found:
    """Summary of the time stamps of a stream, so that a writer need not keep all of them.

    Attributes:
        count: Number of time stamps.
        first_ns: First time stamp, [ns]. It is 0 if there is none.
        last_ns: Last time stamp, [ns]. It is 0 if there is none.
    """

    count: int
    first_ns: int
    last_ns: int

    @classmethod
    def of(cls, t_ns: np.ndarray) -> "Found":
        """Return the summary of the time stamps of a whole stream.

        Args:
            t_ns: Time stamps, shape (M,), [ns].
        """
        return cls(len(t_ns), int(t_ns[0]), int(t_ns[-1])) if len(t_ns) else cls(0, 0, 0)

    @property
    def rate_hz(self) -> float:
        """Rate of the stream by its mean interval, [Hz]; 0 for fewer than two readings or no time between them."""
        span = self.last_ns - self.first_ns
        return (self.count - 1) / span * 1e9 if self.count > 1 and span > 0 else 0.0


def declared_rates(config: Mapping[str, Any]) -> dict[str, float]:
    """Return the nominal rates that a recording declared, [Hz], by group such as ``streams/wrench``.

    Args:
        config: Configuration of the episode (`Meta.config`).
    """
    rates = config.get("rates_hz")
    if not isinstance(rates, Mapping):
        return {}
    return {str(group): float(rate) for group, rate in rates.items() if isinstance(rate, int | float) and rate > 0}


def checked_rates(rates_hz: Mapping[str, Any]) -> dict[str, Any]:
    """Return nominal rates that are to be declared.

    Args:
        rates_hz: Rates by group, [Hz].

    Raises:
        UsageError: If a rate is not a finite number above 0.
    """
    for group, rate in rates_hz.items():
        number = isinstance(rate, int | float) and not isinstance(rate, bool)
        if not number or not 0 < rate < math.inf:
            raise UsageError(f"rates_hz[{group!r}] is {rate!r}; a rate is a number of Hz above 0, such as 500")
    return dict(rates_hz)


def declared_hz(config: Mapping[str, Any], group: str) -> float | None:
    """Return the declared rate of one group, [Hz], or None if no rate was declared for it.

    Args:
        config: Configuration of the episode (`Meta.config`).
        group: Group of the stream, such as ``streams/wrench``.
    """
    return declared_rates(config).get(group)


def unit_fault(group: str, found: Found, declared: float | None = None) -> str | None:
    """Return why the time stamps of a stream cannot be nanoseconds of the episode clock, or None if they can be.

    Args:
        group: Group of the stream, such as ``streams/wrench``.
        found: Summary of the time stamps of the stream.
        declared: Rate that the recording declared, [Hz]. A stream may be as fast as it was declared to be.
    """
    if found.count and (farthest := max(abs(found.first_ns), abs(found.last_ns))) > LONGEST_NS:
        return (
            f"has time stamps {farthest / 86_400e9:.0f} days from the episode's beginning; they must be nanoseconds "
            "since the episode began"
        )
    rate = found.rate_hz
    fastest = max(FASTEST_HZ.get(group.partition("/")[0], FASTEST_OTHER_HZ), DOUBTFUL * (declared or 0.0))
    if found.count >= FEW and rate > fastest:
        return f"comes at {rate:.4g} Hz by its time stamps; they must be nanoseconds, not microseconds or milliseconds"
    return None


def rate_fault(found: Found, declared: float | None) -> tuple[Literal["error", "warning"], str] | None:
    """Compare the rate of a stream with its declared rate.

    Args:
        found: Summary of the time stamps of the stream, without the time of declared gaps.
        declared: Declared rate of the stream, [Hz]. None if no rate was declared.

    Returns:
        Class of the fault and its description, such as ``comes at 50 Hz, but 500 Hz was declared``. None if the rates
        agree, no rate was declared, or there are too few readings to measure a rate.
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
    """Return why the unit of time or the rate of a stream is an error, or None if neither is.

    Args:
        group: Group of the stream, such as ``streams/wrench``.
        found: Summary of the time stamps of the stream, without the time of declared gaps.
        declared: Rate that the recording declared, [Hz]. None if no rate was declared.
    """
    fault = rate_fault(found, declared)
    if fault and fault[0] == "error" and max(abs(found.first_ns), abs(found.last_ns)) <= LONGEST_NS:
        return fault[1]  # this description names the unit, too
    return unit_fault(group, found, declared)


def _unit_words(ratio: float) -> str:
    """Return which unit explains the ratio between a found and a declared rate, as the end of a message."""
    for power, unit in ((3, "microseconds"), (6, "milliseconds"), (9, "seconds")):
        if 10**power / RATE_FACTOR <= ratio <= 10**power * RATE_FACTOR:
            return f"; its time stamps may be {unit} instead of nanoseconds"
    return ""
