"""Functions that cut the observations of a batch out of episodes, and rotate or reflect them."""

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
    """Cut, and rotate or reflect, the images of observations; all images of one observation are treated alike.

    Args:
        episodes: Episode of each observation, B in all.
        steps: Number of each observation in its episode, B in all.
        corners: Upper left pixel (row, column) of each observation's crop, shape (B, 2).
        augmentation: Rotations and reflections of images.
        elements: Number of the element of `augmentation` that is applied to each observation, shape (B,).
        crop: Height and width h of the crops, [px].
        frames: Number of images per observation, K: those of the last K observations. Where the episode has fewer
            observations so far, its first image is repeated.
        depth_scale: Metres per unit of depth.

    Returns:
        Images with RGB 0..1, then depth in [m], latest image last, shape (B, K, 4, h, h), float32.
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
    """Return the wrench windows and the proprioception of observations.

    Args:
        episodes: Episode of each observation, B in all.
        steps: Number of each observation in its episode, B in all.
        window: Number of wrench readings in each window, T.

    Returns:
        ``wrench`` (B, T, 6) and ``proprio`` (B, 5), both float32, in image-aligned axes.
    """
    places = list(zip(episodes, steps, strict=True))
    return {
        "wrench": np.stack([episode.window(step, window) for episode, step in places]),
        "proprio": np.stack([episode.proprio[step] for episode, step in places]),
    }


def rotated(batch: Batch, augmentation: SymmetryAugmentation, elements: np.ndarray) -> Batch:
    """Rotate or reflect the vectors of each sample.

    Args:
        batch: Values with keys of `PARTS`, each of shape (B, ..., C), in image-aligned axes.
        augmentation: Rotations and reflections of vectors.
        elements: Number of the element of `augmentation` that is applied to each sample, shape (B,).

    Returns:
        The transformed values by the same keys, according to their representations (`svfl_data.symmetry`).
    """
    return {name: augmentation.numbers(values, PARTS[name], elements) for name, values in batch.items()}
