"""Windows over the wrench stream, cut when reading: causal, never a reading from after the observation."""

import numpy as np

from svfl_data.episode import Episode

WINDOW = 64
"""Readings in a wrench window (Kohler et al., CoRL 2023, section 5 and appendix: the last 64 readings)."""


def wrench_window(episode: Episode, step: int = -1, length: int = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """The last readings at or before an observation, tared.

    Args:
        episode: Where to cut.
        step: Row of the observation; -1 is the final one.
        length: Number of readings T.

    Returns:
        The window, shape (T, 6), float32, [N] and [N m], base axes, about the sensor origin, latest reading last;
        and a mask of shape (T,), true where there was no reading yet and the first one is repeated (zeros if the
        stream is still empty).
    """
    end = int(episode.wrench_end[step])
    readings = episode.tared_wrench[max(0, end - length) : end]
    missing = length - len(readings)
    filler = readings[:1] if len(readings) else np.zeros((1, 6), dtype=np.float32)
    window = np.concatenate([np.repeat(filler, missing, axis=0), readings])
    return window, np.arange(length) < missing
