"""A pretrained latent encoder as the trunk of a classifier."""

from typing import Any

import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODELS, Sizes
from svfl_models.latent.inputs import IMAGE_SIZE, WINDOW, Inputs
from svfl_models.latent.networks.encoder import Encoder
from svfl_models.latent.networks.network import ENCODERS, LatentNetwork
from svfl_models.networks.normalization import Normalization
from svfl_models.networks.visual_force import Batch

SMALLEST = 1e-6
"""Least deviation that a feature is divided by."""


class LatentTrunk(nn.Module):
    """What a latent encoder makes of image, wrench window and gripper, each feature in units of its deviation.

    The inputs keep the statistics of the pretraining, without which its weights mean nothing; the features' own are of
    the training samples. The encoder stays in eval mode also while it is fine-tuned: PoE's feature is its mean, as it
    is when the classifier is used, and not a draw.

    Args:
        model: One of `latent.config.MODELS`.
        sizes: Of the networks, as `latent.config.plain` writes them.

    Raises:
        TrainingError: If there is no such model.
    """

    feature_mean: Tensor
    feature_scale: Tensor
    image_size, window = IMAGE_SIZE, WINDOW

    def __init__(self, model: str, sizes: dict[str, Any]) -> None:
        super().__init__()
        if model not in ENCODERS:
            raise TrainingError(f"no latent model {model!r}; there are {', '.join(MODELS)}")
        read = Sizes(**sizes)
        self.inputs = Inputs()
        self.encoder: Encoder = ENCODERS[model](read).eval()
        self.width = read.feature
        self.register_buffer("feature_mean", torch.zeros(self.width))
        self.register_buffer("feature_scale", torch.ones(self.width))

    @property
    def normalization(self) -> Normalization:
        """Statistics of the inputs."""
        return self.inputs.normalization

    def take_over(self, pretrained: LatentNetwork, weights: bool = True) -> None:
        """Copy the statistics of a pretrained network's inputs and, unless a control must do without, its weights."""
        self.inputs.load_state_dict(pretrained.inputs.state_dict())
        if weights:
            self.encoder.load_state_dict(pretrained.encoder.state_dict())

    @torch.no_grad()
    def fit(self, batch: Batch) -> None:
        """Take the statistics of the features from training samples."""
        feature = self._feature(batch)
        self.feature_mean.copy_(feature.mean(dim=0))
        self.feature_scale.copy_(feature.std(dim=0).clamp_min(SMALLEST))

    def train(self, mode: bool = True) -> "LatentTrunk":
        """As ever, except for the encoder."""
        super().train(mode)
        self.encoder.eval()
        return self

    def forward(self, batch: Batch) -> Tensor:
        """Features (B, F): of ``image``, ``wrench`` and ``proprio``, or ``feature`` itself if it is there already.

        Raises:
            TrainingError: If an input is missing or has another shape than in the pretraining.
        """
        if "feature" in batch:
            return batch["feature"]
        return (self._feature(batch) - self.feature_mean) / self.feature_scale

    def _feature(self, batch: Batch) -> Tensor:
        return self.encoder(self.inputs(batch)).feature
