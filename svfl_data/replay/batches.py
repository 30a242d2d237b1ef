"""Cutting observations out of episodes for a whole batch, and turning their worlds."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from svfl_data.replay.recorded import Recorded
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act, act_on_image, dihedral

Batch = dict[str, np.ndarray]
View = tuple[bool, int, int]
D4 = dihedral(4)
PARTS = {"wrench": WRENCH_PARTS, "proprio": PROPRIO_PARTS, "action": ACTION_PARTS}


def seen(pixels: np.ndarray, view: View) -> np.ndarray:
    """Images (..., h, h) seen another way round, without copying them.

    Args:
        pixels: The images.
        view: Whether rows become columns; then the strides, 1 or -1, along rows and columns.
    """
    transposed, down, across = view
    return (pixels.swapaxes(-2, -1) if transposed else pixels)[..., ::down, ::across]


def _view_of(matrix: np.ndarray) -> View:
    """The view that moves pixels as `act_on_image` does, in a fraction of its time."""
    tell_tale = np.arange(4).reshape(2, 2)
    wanted = act_on_image(matrix, tell_tale)
    views = product((False, True), (1, -1), (1, -1))
    return next(view for view in views if np.array_equal(seen(tell_tale, view), wanted))


VIEWS = tuple(_view_of(matrix) for matrix in D4)
"""How an image looks when it has been moved by each element of `D4`; the first leaves it as it is."""


def images(
    episodes: Sequence[Recorded],
    steps: Sequence[int],
    corners: np.ndarray,
    elements: np.ndarray,
    crop: int,
    depth_scale: float,
) -> np.ndarray:
    """Crops of observed images, turned.

    Args:
        episodes: Of each observation.
        steps: Which of its episode.
        corners: Upper left pixel (row, column) of each crop, shape (B, 2).
        elements: Which element of `D4` moves each, shape (B,).
        crop: Height and width of the crops h, [px].
        depth_scale: Metres per unit of depth.

    Returns:
        RGB 0..1, then depth in [m], shape (B, 4, h, h), float32.
    """
    out = np.empty((len(episodes), 4, crop, crop), np.float32)
    brightest, scale = np.float32(255), np.float32(depth_scale)
    places = zip(episodes, steps, corners.tolist(), elements.tolist(), strict=True)
    for image, (episode, step, (top, left), element) in zip(out, places, strict=True):
        box = np.s_[..., top : top + crop, left : left + crop]
        image[:3] = seen(episode.color[step][box], VIEWS[element])
        image[3] = seen(episode.depth[step][box], VIEWS[element])
        image[:3] /= brightest  # at once, while the pixels are in the cache
        image[3] *= scale
    return out


def vectors(episodes: Sequence[Recorded], steps: Sequence[int], window: int) -> Batch:
    """What was felt and known at observations: ``wrench`` (B, T, 6) and ``proprio`` (B, 5), float32.

    Args:
        episodes: Of each observation.
        steps: Which of its episode.
        window: Wrench readings, T.
    """
    places = list(zip(episodes, steps, strict=True))
    return {
        "wrench": np.stack([episode.window(step, window) for episode, step in places]),
        "proprio": np.stack([episode.proprio[step] for episode, step in places]),
    }


def turned(batch: Batch, elements: np.ndarray) -> Batch:
    """Turn and mirror the vectors of each sample.

    Args:
        batch: Entries of `PARTS`.
        elements: Which element of `D4` moves each sample, shape (B,).

    Returns:
        The same keys, moved as `svfl_data.symmetry` says.
    """
    moved = {name: np.empty_like(values) for name, values in batch.items()}
    for number, matrix in enumerate(D4):
        chosen = np.flatnonzero(elements == number)
        for name, values in batch.items():
            moved[name][chosen] = act(matrix, values[chosen], PARTS[name])
    return moved
