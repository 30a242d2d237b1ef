"""Scaling of physical inputs that commutes with the group.

Each representation has one scale, the same for x and y of a vector, and a mean is subtracted from invariants only:
anything else would make a rotated input look different from a rotated output. Statistics come from the training
samples alone and are buffers, so that a checkpoint carries them.
"""

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.sampling.statistics import statistics
from svfl_data.symmetry import PROPRIO_PARTS, WRENCH_PARTS, Part

IMAGE_PARTS = tuple(Part("invariant", (channel,)) for channel in range(4))


class Normalization(nn.Module):
    """Mean and scale of image channels, wrench and proprioception; the identity until `fit` is called.

    The yaw is left alone: it enters a network as sine and cosine.
    """

    image_mean: Tensor
    image_scale: Tensor
    wrench_mean: Tensor
    wrench_scale: Tensor
    proprio_mean: Tensor
    proprio_scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        for name, components in (("image", 4), ("wrench", 6), ("proprio", 5)):
            self.register_buffer(f"{name}_mean", torch.zeros(components))
            self.register_buffer(f"{name}_scale", torch.ones(components))

    def fit(
        self, image: np.ndarray | None = None, wrench: np.ndarray | None = None, proprio: np.ndarray | None = None
    ) -> None:
        """Take the statistics of the training samples, of what there is.

        Args:
            image: Shape (S, 4, H, W): colour / 255, depth in [m].
            wrench: Shape (S, T, 6), [N] and [N m].
            proprio: Shape (S, 5), (x, y) relative to the workspace centre.
        """
        given = (
            ("image", None if image is None else np.moveaxis(image, 1, -1), IMAGE_PARTS),
            ("wrench", wrench, WRENCH_PARTS),
            ("proprio", proprio, tuple(part for part in PROPRIO_PARTS if part.kind != "angle")),
        )
        for name, values, parts in given:
            if values is not None:
                mean, scale = statistics(values, parts)
                getattr(self, f"{name}_mean").copy_(torch.from_numpy(mean))
                getattr(self, f"{name}_scale").copy_(torch.from_numpy(scale))

    def image(self, image: Tensor) -> Tensor:
        """(B, 4, H, W) -> the same shape, dimensionless."""
        return (image - self.image_mean[:, None, None]) / self.image_scale[:, None, None]

    def wrench(self, wrench: Tensor) -> Tensor:
        """(B, T, 6) -> the same shape, dimensionless."""
        return (wrench - self.wrench_mean) / self.wrench_scale

    def proprio(self, proprio: Tensor) -> Tensor:
        """(B, 5) -> the same shape, dimensionless."""
        return (proprio - self.proprio_mean) / self.proprio_scale
