"""Windows over streams with clocks of their own, cut when reading: causal, never a reading from after its step."""

import numpy as np

from svfl_data.schema.clocks import Clock
from svfl_data.schema.episode import Episode

WINDOW = 64
"""Readings in a wrench window (Kohler et al., CoRL 2023, section 5 and appendix: the last 64 readings)."""


def latest(t_ns: np.ndarray, now_ns: int) -> int:
    """Row of the last reading at or before a moment; -1 if there is none.

    Args:
        t_ns: Ascending timestamps of a stream, shape (M,), [ns].
        now_ns: The moment, same clock, [ns].
    """
    return int(np.searchsorted(t_ns, now_ns, side="right")) - 1


def wrench_window(episode: Episode, step: int = -1, length: int = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """The last readings at or before an observation, tared.

    Args:
        episode: Where to cut.
        step: Row of the observation; -1 is the final one.
        length: Number of readings T.

    Returns:
        The window, shape (T, 6), float32, [N] and [N m], base axes, about the sensor origin, latest reading last;
        and a mask of shape (T,), true where there was no reading yet and the first one is repeated (zeros if the
        stream is still empty), and where a reading is left over from before a break (`svfl_data.schema.clocks.Clock`).

    Example:
        >>> window, padding = wrench_window(dataset[0], step=20)
        >>> window.shape, bool(padding.any())
        ((64, 6), False)
    """
    now = episode.t_ns[step]
    end = latest(episode.wrench_t_ns, now) + 1
    (fresh,) = Clock.of(episode.meta, "streams/wrench").first_fresh(episode.wrench_t_ns, np.array([now]))
    readings = episode.tared_wrench[max(0, end - length) : end]
    missing = length - len(readings)
    filler = readings[:1] if len(readings) else np.zeros((1, 6), dtype=np.float32)
    window = np.concatenate([np.repeat(filler, missing, axis=0), readings])
    return window, np.arange(end - length, end) < fresh
