"""Clock that times the actions, and measures how steady the timing was."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

PERIOD_NS = 50_000_000
"""Time from one action to the next in simulation, [ns]: 20 Hz."""


class Clock:
    """Clock that waits for the next beat, the time of the next action.

    Args:
        paced: Whether the clock waits; if not, it only measures the beats.
        period_ns: Time from one beat to the next, [ns].
    """

    def __init__(self, paced: bool = True, period_ns: int = PERIOD_NS) -> None:
        self.paced, self._period_ns = paced, period_ns
        self.begin()

    def begin(self) -> None:
        """Forget all beats, so that the next beat counts as the first."""
        self._beats: list[int] = []
        self._due: int | None = None

    def wait(self) -> None:
        """Wait until the next beat.

        After a delay of a period or more, the following beats are counted from the late one, since the person could not
        control a burst of actions.
        """
        now = time.monotonic_ns()
        due = now if self._due is None else self._due
        if self.paced and now < due:
            time.sleep((due - now) / 1e9)
            now = time.monotonic_ns()
        self._beats.append(now)
        self._due = (due if now - due < self._period_ns else now) + self._period_ns

    def beats_ns(self, count: int) -> NDArray[np.int64]:
        """Return the times of the first beats since the first beat, [ns], on a clock that runs in real time.

        Args:
            count: Number of beats.

        Returns:
            The times, (count,), or fewer if there have not been that many beats.
        """
        beats = np.array(self._beats[:count], np.int64)
        return beats - beats[:1]

    def words(self) -> str:
        """Return a text on how steady the last two seconds were, for the screen; empty if the clock does not wait."""
        found = self.steadiness(np.array(self._beats[-41:], np.int64))
        if not (self.paced and found):
            return ""
        return f"{found['rate_hz']:.1f} Hz, jitter {found['jitter_ms']['median']:.1f} ms"

    def steadiness(self, beats_ns: NDArray[np.int64]) -> dict[str, Any]:
        """Return how steady beats were, as JSON values.

        Args:
            beats_ns: Times of the beats, (N,), [ns].
        """
        return steadiness(beats_ns, self._period_ns)


def steadiness(beats_ns: NDArray[np.int64], period_ns: int = PERIOD_NS) -> dict[str, Any]:
    """Return how steady beats were, as JSON values.

    Args:
        beats_ns: Times of the beats, (N,), [ns].
        period_ns: Time from one beat to the next that was meant, [ns].

    Returns:
        ``rate_hz``, the rate; ``jitter_ms``, the distance of the periods from the meant one (median, 99th percentile,
        largest), [ms]; and ``late``, the number of periods over one and a half times that. The result is empty for
        fewer than two beats.
    """
    periods = np.diff(beats_ns)
    if not periods.size:
        return {}
    jitter = np.abs(periods - period_ns) / 1e6
    median, high, largest = np.percentile(jitter, [50, 99, 100])
    return {
        "rate_hz": round(1e9 / max(float(periods.mean()), 1.0), 3),
        "jitter_ms": {"median": round(median, 3), "p99": round(high, 3), "max": round(largest, 3)},
        "late": int((periods > 1.5 * period_ns).sum()),
    }
