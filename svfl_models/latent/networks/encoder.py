"""Common interface of the three encoders."""

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES
from svfl_models.latent.networks.gaussian import Gaussian
from svfl_models.latent.networks.portion import Portion

SLOPE = 0.2
"""Slope of LeakyReLU below zero (VTT's published code)."""
Parts = dict[str, Tensor]
"""What an encoder computes from each modality alone, by the name of the modality, with the batch as first dimension."""


@dataclass(frozen=True, eq=False)
class Encoding:
    """Output of an encoder for B observations.

    Attributes:
        feature: Feature of each observation, shape (B, F).
        contact: Logit that the gripper is in contact, shape (B,).
        alignment: Logit that image and wrench belong together, shape (B,).
        posterior: Distribution whose random draw or mean `feature` is computed from; None for encoders other than PoE.
    """

    feature: Tensor
    contact: Tensor
    alignment: Tensor
    posterior: Gaussian | None = None


class Encoder(nn.Module):
    """Encoder in two stages: each modality is processed alone, then all are joined.

    The stages are separate so that the wrench of one observation can be joined with the image of another without
    processing either again.
    """

    def part(self, name: str, values: Tensor) -> Tensor:
        """Process one modality alone; the values come from `Inputs` and have one leading dimension."""
        raise NotImplementedError

    def parts(self, inputs: Mapping[str, Tensor]) -> Parts:
        """Process each modality of `inputs` alone."""
        return {name: self.part(name, inputs[name]) for name in MODALITIES if name in inputs}

    def join(self, parts: Parts, portion: Portion | None = None) -> Encoding:
        """Join the processed modalities.

        Args:
            parts: What `parts` returns.
            portion: Part of a batch that the observations are, for random draws; None for a whole batch.
        """
        raise NotImplementedError

    def forward(self, inputs: Mapping[str, Tensor]) -> Encoding:
        """Encode ``image`` (B, 4, 64, 64), ``wrench`` (B, 64, 6) and ``proprio`` (B, 6), as `Inputs` returns them."""
        return self.join(self.parts(inputs))


def all_of(parts: Mapping[str, Tensor]) -> list[Tensor]:
    """Return the values of the three modalities in the order of `config.MODALITIES`.

    Raises:
        TrainingError: If a modality is missing.
    """
    missing = [name for name in MODALITIES if name not in parts]
    if missing:
        raise TrainingError(
            f"this encoder needs {', '.join(MODALITIES)}; missing: {', '.join(missing)} (PoE does without)"
        )
    return [parts[name] for name in MODALITIES]
