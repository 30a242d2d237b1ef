"""Windows over streams that have their own clocks; a window is cut when read and has no reading from after its step."""

import numpy as np

from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import WINDOW as WINDOW  # imported for users of this module
from svfl_data.schema.input_spec import WRENCH, InputSpec, Window


def latest(t_ns: np.ndarray, now_ns: int) -> int:
    """Return the row of the last reading at or before a time; -1 if there is none.

    Args:
        t_ns: Ascending timestamps of a stream, shape (M,), [ns].
        now_ns: Time on the same clock, [ns].
    """
    return int(np.searchsorted(t_ns, now_ns, side="right")) - 1


def wrench_window(episode: Episode, step: int = -1, length: int = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """Return the last tared wrench readings at or before an observation.

    Args:
        episode: Episode to cut the window from.
        step: Row of the observation; -1 is the final observation.
        length: Number of readings in the window, T.

    Returns:
        The window, shape (T, 6), float32, [N] and [N m], base axes, about the sensor origin, latest reading last;
        and a padding mask of shape (T,). The mask is true where the episode had no reading yet, so that the first
        reading is repeated (or zeros are given if there is no reading so far), and where a reading is from before a
        break in the stream (`svfl_data.schema.clocks.Clock`).

    Example:
        >>> window, padding = wrench_window(dataset[0], step=20)
        >>> window.shape, bool(padding.any())
        ((64, 6), False)
    """
    seen = cut_steps(episode, InputSpec(windows={WRENCH: Window(length)}), [step])
    return seen[WRENCH][0], seen["streams/wrench/padding"][0]
