"""Trunk of a classifier that is a pretrained latent encoder."""

from typing import Any

import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODELS, Sizes
from svfl_models.latent.inputs import IMAGE_SIZE, WINDOW, Inputs
from svfl_models.latent.networks.encoder import Encoder
from svfl_models.latent.networks.network import ENCODERS, LatentNetwork
from svfl_models.networks.inputs import CROP
from svfl_models.networks.normalization import Normalization
from svfl_models.symmetry.actions import Batch

SMALLEST = 1e-6
"""Smallest standard deviation that a feature is divided by."""


class LatentTrunk(nn.Module):
    """Latent encoder of image, wrench window and proprioception that returns standardised features.

    The inputs are scaled with the statistics of the pretraining, because the pretrained weights fit no other scales.
    The features are scaled with the mean and standard deviation over the training samples of the classifier. The
    encoder stays in eval mode even while it is fine-tuned: the feature of PoE is then its mean, as it is when the
    classifier is used, and not a random draw.

    Args:
        model: Kind of latent model, one of `latent.config.MODELS`.
        sizes: Layer sizes of the latent networks, as `latent.config.plain` returns them.

    Raises:
        TrainingError: If `model` is not one of `latent.config.MODELS`.
    """

    feature_mean: Tensor
    feature_scale: Tensor
    image_size, window, crop = IMAGE_SIZE, WINDOW, CROP

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
        """Statistics of the inputs, taken in the pretraining."""
        return self.inputs.normalization

    def take_over(self, pretrained: LatentNetwork, weights: bool = True) -> None:
        """Copy the input statistics and the encoder weights of a pretrained network.

        Args:
            pretrained: The pretrained network, of the same model and sizes.
            weights: Whether the weights are copied as well. False is for a control that is trained from random weights.
        """
        self.inputs.load_state_dict(pretrained.inputs.state_dict())
        if weights:
            self.encoder.load_state_dict(pretrained.encoder.state_dict())

    @torch.no_grad()
    def fit(self, batch: Batch) -> None:
        """Take the mean and standard deviation of the features from a batch that holds all training samples."""
        feature = self._feature(batch)
        self.feature_mean.copy_(feature.mean(dim=0))
        self.feature_scale.copy_(feature.std(dim=0).clamp_min(SMALLEST))

    def train(self, mode: bool = True) -> "LatentTrunk":
        """Set the training mode as in PyTorch, but leave the encoder in eval mode."""
        super().train(mode)
        self.encoder.eval()
        return self

    def forward(self, batch: Batch) -> Tensor:
        """Return features of shape (B, F).

        Args:
            batch: Inputs ``image``, ``wrench`` and ``proprio``. If the batch has an entry ``feature``, it is returned
                as it is.

        Raises:
            TrainingError: If an input is missing or has another shape than in the pretraining.
        """
        if "feature" in batch:
            return batch["feature"]
        return (self._feature(batch) - self.feature_mean) / self.feature_scale

    def _feature(self, batch: Batch) -> Tensor:
        return self.encoder(self.inputs(batch)).feature
