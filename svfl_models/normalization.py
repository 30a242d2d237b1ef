"""Scaling of physical inputs that commutes with the group.

Each representation has one scale, the same for x and y of a vector, and a mean is subtracted from invariants only:
anything else would make a rotated input look different from a rotated output. Statistics come from the training
samples alone and are buffers, so that a checkpoint carries them.
"""

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.statistics import statistics
from svfl_data.symmetry import WRENCH_PARTS, Part

IMAGE_PARTS = tuple(Part("invariant", (channel,)) for channel in range(4))


class Normalization(nn.Module):
    """Mean and scale of image channels and wrench components; the identity until `fit` is called."""

    image_mean: Tensor
    image_scale: Tensor
    wrench_mean: Tensor
    wrench_scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("image_mean", torch.zeros(4))
        self.register_buffer("image_scale", torch.ones(4))
        self.register_buffer("wrench_mean", torch.zeros(6))
        self.register_buffer("wrench_scale", torch.ones(6))

    def fit(self, image: np.ndarray, wrench: np.ndarray) -> None:
        """Take the statistics of the training samples.

        Args:
            image: Shape (S, 4, H, W): colour / 255, depth in [m].
            wrench: Shape (S, T, 6), [N] and [N m].
        """
        for name, values, parts in (
            ("image", np.moveaxis(image, 1, -1), IMAGE_PARTS),
            ("wrench", wrench, WRENCH_PARTS),
        ):
            mean, scale = statistics(values, parts)
            getattr(self, f"{name}_mean").copy_(torch.from_numpy(mean))
            getattr(self, f"{name}_scale").copy_(torch.from_numpy(scale))

    def image(self, image: Tensor) -> Tensor:
        """(B, 4, H, W) -> the same shape, dimensionless."""
        return (image - self.image_mean[:, None, None]) / self.image_scale[:, None, None]

    def wrench(self, wrench: Tensor) -> Tensor:
        """(B, T, 6) -> the same shape, dimensionless."""
        return (wrench - self.wrench_mean) / self.wrench_scale
