"""What the three encoders have in common: the same call, the same answer."""

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES
from svfl_models.latent.networks.gaussian import Gaussian

SLOPE = 0.2
"""Of LeakyReLU below zero (VTT's published code)."""
Parts = dict[str, Tensor]
"""What was made of each modality alone, batch first."""


@dataclass(frozen=True, eq=False)
class Encoding:
    """What an encoder says about observations.

    Attributes:
        feature: Shape (B, F).
        contact: Logit that the gripper is in contact, shape (B,).
        alignment: Logit that image and wrench belong together, shape (B,).
        posterior: Distribution that `feature` stems from, where the encoder has one.
    """

    feature: Tensor
    contact: Tensor
    alignment: Tensor
    posterior: Gaussian | None = None


class Encoder(nn.Module):
    """Makes something of each modality alone, then of all together.

    The two stages are apart so that the wrench of one observation can be joined with the image of another without
    looking at either again.
    """

    def parts(self, inputs: Mapping[str, Tensor]) -> Parts:
        """What each modality says: from `Inputs`, with one leading dimension."""
        raise NotImplementedError

    def join(self, parts: Parts) -> Encoding:
        """What they say together."""
        raise NotImplementedError

    def forward(self, inputs: Mapping[str, Tensor]) -> Encoding:
        """``image`` (B, 4, 64, 64), ``wrench`` (B, 64, 6), ``proprio`` (B, 6), as `Inputs` makes them."""
        return self.join(self.parts(inputs))


def all_of(parts: Mapping[str, Tensor]) -> list[Tensor]:
    """The three modalities in their order.

    Raises:
        TrainingError: If one is missing.
    """
    missing = [name for name in MODALITIES if name not in parts]
    if missing:
        raise TrainingError(
            f"this encoder needs {', '.join(MODALITIES)}; missing: {', '.join(missing)} (PoE does without)"
        )
    return [parts[name] for name in MODALITIES]
