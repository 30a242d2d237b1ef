"""Cutting observations out of episodes for a whole batch, and turning their worlds."""

from collections.abc import Sequence

import numpy as np

from svfl_data.replay.stored_episode import StoredEpisode
from svfl_data.replay.symmetry_augmentation import SymmetryAugmentation
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS

Batch = dict[str, np.ndarray]
PARTS = {"wrench": WRENCH_PARTS, "proprio": PROPRIO_PARTS, "action": ACTION_PARTS}


def images(
    episodes: Sequence[StoredEpisode],
    steps: Sequence[int],
    corners: np.ndarray,
    augmentation: SymmetryAugmentation,
    elements: np.ndarray,
    crop: int,
    frames: int,
    depth_scale: float,
) -> np.ndarray:
    """Crops of observed images, rotated or reflected; all those of one observation alike.

    Args:
        episodes: Of each observation.
        steps: Which of its episode.
        corners: Upper left pixel (row, column) of each crop, shape (B, 2).
        augmentation: How images may be rotated and reflected.
        elements: Which element of `augmentation` moves each, shape (B,).
        crop: Height and width of the crops h, [px].
        frames: Images up to each observation, K; before an episode began there is its first one.
        depth_scale: Metres per unit of depth.

    Returns:
        RGB 0..1, then depth in [m], latest image last, shape (B, K, 4, h, h), float32.
    """
    out = np.empty((len(episodes), frames, 4, crop, crop), np.float32)
    brightest, scale = np.float32(255), np.float32(depth_scale)
    places = zip(episodes, steps, corners.tolist(), elements.tolist(), strict=True)
    for stack, (episode, step, corner, element) in zip(out, places, strict=True):
        for image, row in zip(stack, range(step - frames + 1, step + 1), strict=True):
            row = max(0, row)
            augmentation.image(image, episode.color[row], episode.depth[row], corner, element)
            image[:3] /= brightest  # at once, while the pixels are in the cache
            image[3] *= scale
    return out


def vectors(episodes: Sequence[StoredEpisode], steps: Sequence[int], window: int) -> Batch:
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


def rotated(batch: Batch, augmentation: SymmetryAugmentation, elements: np.ndarray) -> Batch:
    """Turn and mirror the vectors of each sample.

    Args:
        batch: Entries of `PARTS`.
        augmentation: How they may be rotated and reflected.
        elements: Which element of `augmentation` moves each sample, shape (B,).

    Returns:
        The same keys, moved as `svfl_data.symmetry` says.
    """
    return {name: augmentation.numbers(values, PARTS[name], elements) for name, values in batch.items()}
