"""Scaling of physical inputs that commutes with the group.

Each representation has one scale, the same for x and y of a vector, and a mean is subtracted from invariants only.
Otherwise normalising a rotated input would not give the rotated normalised input. The statistics come from the training
samples alone. They are buffers of the module, so that a checkpoint contains them.
"""

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.sampling.statistics import statistics
from svfl_data.symmetry import PROPRIO_PARTS, WRENCH_PARTS, Part

IMAGE_PARTS = tuple(Part("invariant", (channel,)) for channel in range(4))


class Normalization(nn.Module):
    """Mean and scale of image channels, wrench and proprioception; the identity until `fit` is called.

    The yaw is not changed, because it enters a network as the cosine and sine of its double.
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
        """Set means and scales to the statistics of the training samples.

        Inputs that are None keep their means and scales.

        Args:
            image: Images, shape (S, 4, H, W): colour / 255, then depth in [m].
            wrench: Wrench windows, shape (S, T, 6), [N] and [N m].
            proprio: Proprioception, shape (S, 5), with (x, y) relative to the workspace centre.
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
        """Return normalised images, dimensionless, of the same shape (B, 4, H, W) as the input."""
        return (image - self.image_mean[:, None, None]) / self.image_scale[:, None, None]

    def wrench(self, wrench: Tensor) -> Tensor:
        """Return normalised wrench windows, dimensionless, of the same shape (B, T, 6) as the input."""
        return (wrench - self.wrench_mean) / self.wrench_scale

    def proprio(self, proprio: Tensor) -> Tensor:
        """Return normalised proprioception, of the same shape (B, 5) as the input, dimensionless but for the yaw."""
        return (proprio - self.proprio_mean) / self.proprio_scale
