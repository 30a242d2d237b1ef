"""From physical observations to what networks like to read, with the statistics of the training episodes."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES
from svfl_models.networks.normalization import Normalization
from svfl_models.networks.squashed_gaussian import to_unit

IMAGE_SIZE, WINDOW, PROPRIO = 64, 64, 6
SHAPES = {"image": (4, IMAGE_SIZE, IMAGE_SIZE), "wrench": (WINDOW, 6), "proprio": (5,)}
Batch = dict[str, Tensor]
"""Physical values, vectors in image-aligned axes; shapes of `SHAPES` behind (B, T), see `data.Sequences`."""


class Inputs(nn.Module):
    """Scales every modality; carries its statistics as buffers.

    The wrench, in units of its deviation, goes through asinh: it is in proportion where little is felt, and a collision
    of fifty deviations is still told from one of a hundred (a tanh of newtons would say 1 to both).
    """

    def __init__(self) -> None:
        super().__init__()
        self.normalization = Normalization()

    def fit(self, image: np.ndarray, wrench: np.ndarray, proprio: np.ndarray) -> None:
        """Take the statistics of training observations: (N, 4, H, W), (N, 64, 6), (N, 5)."""
        self.normalization.fit(image, wrench, proprio)

    def forward(self, batch: Mapping[str, Tensor], only: Sequence[str] = MODALITIES) -> Batch:
        """What encoders read.

        Args:
            batch: Physical observations, any leading dimensions.
            only: Modalities to prepare.

        Returns:
            ``image`` (..., 4, 64, 64), ``wrench`` (..., 64, 6), ``proprio`` (..., 6), dimensionless.

        Raises:
            TrainingError: If a modality is missing or has another shape.
        """
        return {name: getattr(self, name)(_expect(batch, name)) for name in only}

    def image(self, image: Tensor) -> Tensor:
        """Colour and depth; a pixel without depth counts as one of mean depth."""
        scaled = self.normalization.image(image)
        return torch.cat([scaled[..., :3, :, :], scaled[..., 3:, :, :] * (image[..., 3:, :, :] > 0)], dim=-3)

    def wrench(self, wrench: Tensor) -> Tensor:
        """Wrench windows."""
        return torch.asinh(self.normalization.wrench(wrench))

    def proprio(self, proprio: Tensor) -> Tensor:
        """Opening, x, y, z, then the yaw as cosine and sine of its double: a two-fingered gripper has period pi."""
        yaw = 2 * proprio[..., 4:]
        return torch.cat([self.normalization.proprio(proprio)[..., :4], yaw.cos(), yaw.sin()], dim=-1)

    def action(self, action: Tensor) -> Tensor:
        """Actions (..., 5), each component -1..1."""
        return to_unit(action)


def _expect(batch: Mapping[str, Tensor], name: str) -> Tensor:
    if name not in batch:
        raise TrainingError(f"the batch has no {name!r}; it has {', '.join(sorted(batch))}")
    shape = SHAPES[name]
    if tuple(batch[name].shape[-len(shape) :]) != shape:
        raise TrainingError(
            f"{name!r} has shape {tuple(batch[name].shape)}; expected (..., {', '.join(map(str, shape))})"
        )
    return batch[name]
