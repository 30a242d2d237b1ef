"""Scales physical observations to the inputs of the networks, with the statistics of the training episodes."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES
from svfl_models.networks.action_space import PLANAR
from svfl_models.networks.normalization import Normalization
from svfl_models.symmetry.actions import Batch

IMAGE_SIZE, WINDOW, PROPRIO = 64, 64, 6
SHAPES = {"image": (4, IMAGE_SIZE, IMAGE_SIZE), "wrench": (WINDOW, 6), "proprio": (5,)}
"""Shapes of the physical values of a batch after (B, T), see `data.Sequences`."""


class Inputs(nn.Module):
    """Scales each modality with statistics that it holds as buffers.

    The wrench, in units of its deviation, passes through asinh. This is nearly linear for small values, and it still
    separates a collision of fifty deviations from one of a hundred, which a tanh of newtons would both map to 1.
    """

    def __init__(self) -> None:
        super().__init__()
        self.normalization = Normalization()

    def fit(self, image: np.ndarray, wrench: np.ndarray, proprio: np.ndarray) -> None:
        """Take the statistics of training observations.

        Args:
            image: Colour 0..1, then depth in [m], shape (N, 4, H, W).
            wrench: Wrench windows in image-aligned axes, shape (N, 64, 6), [N] and [N m].
            proprio: Proprioception in image-aligned axes, (x, y) relative to the workspace centre, shape (N, 5).
        """
        self.normalization.fit(image=image, wrench=wrench, proprio=proprio)

    def forward(self, batch: Mapping[str, Tensor], only: Sequence[str] = MODALITIES) -> Batch:
        """Return the inputs of an encoder.

        Args:
            batch: Physical observations, with any leading dimensions.
            only: Names of the modalities to prepare.

        Returns:
            ``image`` (..., 4, 64, 64), ``wrench`` (..., 64, 6) and ``proprio`` (..., 6), dimensionless.

        Raises:
            TrainingError: If a modality is missing or has another shape.
        """
        return {name: getattr(self, name)(_expect(batch, name)) for name in only}

    def image(self, image: Tensor) -> Tensor:
        """Scale colour and depth, shape (..., 4, H, W); a pixel without depth (0) gets the mean depth."""
        scaled = self.normalization.scaled("image", image)
        scaled[..., 3, :, :] *= image[..., 3, :, :] > 0
        return scaled

    def wrench(self, wrench: Tensor) -> Tensor:
        """Scale wrench windows, shape (..., 64, 6)."""
        return torch.asinh(self.normalization.scaled("wrench", wrench))

    def proprio(self, proprio: Tensor) -> Tensor:
        """Scale proprioception (..., 5) to (..., 6): opening, x, y, z, then cosine and sine of twice the yaw.

        The yaw is doubled because a gripper with two fingers looks the same after half a turn.
        """
        yaw = 2 * proprio[..., 4:]
        return torch.cat([self.normalization.scaled("proprio", proprio)[..., :4], yaw.cos(), yaw.sin()], dim=-1)

    def action(self, action: Tensor) -> Tensor:
        """Scale actions, shape (..., 5), to -1..1 in each component."""
        return PLANAR.to_unit(action)


def _expect(batch: Mapping[str, Tensor], name: str) -> Tensor:
    if name not in batch:
        raise TrainingError(f"the batch has no {name!r}; it has {', '.join(sorted(batch))}")
    shape = SHAPES[name]
    if tuple(batch[name].shape[-len(shape) :]) != shape:
        raise TrainingError(
            f"{name!r} has shape {tuple(batch[name].shape)}; expected (..., {', '.join(map(str, shape))})"
        )
    return batch[name]
