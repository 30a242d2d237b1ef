"""Random changes of training images that do not change the correct output: the scene's place in the image, its colours.

From ten to a hundred images a network cannot learn that colours and places do not matter, so the training varies them.
Symmetric networks and CNN baselines get the same augmentation (docs/decisions.md says how much it improves accuracy).
"""

import torch
from torch import Tensor

GAIN = 0.3
"""Largest change of a colour channel's contrast, as a share of the contrast."""
OFFSET = 0.2
"""Largest change of a colour channel's brightness, where colours are 0..1."""
DEPTH = 0.05
"""Largest change of an image's depth, by which all its pixels are shifted together, [m]."""
MARGIN = 8 / 76
"""Largest distance by which a crop may reach beyond an image's edges, as a share of the image's side."""
WHITE = (0.033, 0.033, 0.133, 0.0017, 0.0017, 0.00033)
"""Standard deviation of the noise of one reading (fx, fy, fz, mx, my, mz) at level 1, [N] and [N m]: a sixth of the
noise-free resolution of OnRobot's HEX-E/H QC (datasheet v1.5), the sensor that the simulation models."""


def recoloured(image: Tensor) -> Tensor:
    """Change the colours and the depth of images at random.

    For each image, the three colour channels are shuffled, the contrast and brightness of each channel are changed
    (`GAIN`, `OFFSET`), and all depths are shifted by the same distance (`DEPTH`).

    Args:
        image: Images, shape (B, 4, H, H): colour 0..1, then depth in [m].

    Returns:
        The changed images, of the same shape. Colours may lie outside 0..1.
    """
    count = len(image)
    places = torch.rand(count, 3).argsort(dim=1)  # a random order of the channels
    color = image[torch.arange(count)[:, None], places]
    color = color * (1 + GAIN * _uniform(count, 3)) + OFFSET * _uniform(count, 3)
    return torch.cat([color, image[:, 3:] + DEPTH * _uniform(count, 1)], dim=1)


def _uniform(count: int, channels: int) -> Tensor:
    """Return random numbers between -1 and 1, shape (count, channels, 1, 1)."""
    return 2 * torch.rand(count, channels, 1, 1) - 1
