"""Changes of a training image that leave the answer alone: where the scene lies in the picture, how it is coloured.

Ten to a hundred pictures do not say that colours and places mean nothing; these say it for them. Both kinds of network
get the same (docs/decisions.md has what it is worth).
"""

import torch
from torch import Tensor

GAIN = 0.3
"""Largest change of a colour channel's contrast, as a share."""
OFFSET = 0.2
"""Largest change of its brightness; colours are 0..1."""
DEPTH = 0.05
"""Largest change of all depths of a picture, [m]."""
MARGIN = 8 / 76
"""How far a crop may reach beyond the picture's edges, as a share of its side."""


def recoloured(image: Tensor) -> Tensor:
    """Pictures in other light and colours: channels change places, contrast and brightness; depth moves as a whole.

    Args:
        image: Shape (B, 4, H, H): colour 0..1, then depth in [m].

    Returns:
        The same shape.
    """
    count = len(image)
    places = torch.rand(count, 3).argsort(dim=1)  # a random order of the channels
    color = image[torch.arange(count)[:, None], places]
    color = color * (1 + GAIN * _uniform(count, 3)) + OFFSET * _uniform(count, 3)
    return torch.cat([color, image[:, 3:] + DEPTH * _uniform(count, 1)], dim=1)


def _uniform(count: int, channels: int) -> Tensor:
    """Between -1 and 1, shape (B, C, 1, 1)."""
    return 2 * torch.rand(count, channels, 1, 1) - 1
