"""Concatenation: an encoder that joins one vector per modality and applies a linear layer."""

import torch
from torch import Tensor, nn

from svfl_models.latent.config import Sizes
from svfl_models.latent.inputs import PROPRIO
from svfl_models.latent.networks.encoder import Encoder, Encoding, Parts, all_of
from svfl_models.latent.networks.portion import Portion
from svfl_models.latent.networks.trunks import ImageTrunk, WrenchTrunk, perceptron


class ConcatEncoder(Encoder):
    """Encoder that fuses the modalities by concatenation, the simplest way (VTT's published baseline of this name).

    Args:
        sizes: Layer sizes of the networks.
    """

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        image, wrench, proprio = sizes.concat
        self.trunks = nn.ModuleDict(
            {
                "image": ImageTrunk(sizes.image, image),
                "wrench": WrenchTrunk(sizes.wrench, wrench),
                "proprio": perceptron(PROPRIO, sizes.proprio, proprio),
            }
        )
        self.norm = nn.LayerNorm(sum(sizes.concat))
        self.bottleneck = nn.Linear(sum(sizes.concat), sizes.feature)
        self.contact = nn.Linear(sizes.feature, 1)
        self.alignment = nn.Linear(sizes.feature, 1)

    def part(self, name: str, values: Tensor) -> Tensor:
        """Return the vector of a modality, shape (B, C) with C from `Sizes.concat`."""
        part: Tensor = self.trunks[name](values)
        return part

    def join(self, parts: Parts, portion: Portion | None = None) -> Encoding:
        """Apply the layer norm and the linear layers to the joined vectors."""
        feature = self.bottleneck(self.norm(torch.cat(all_of(parts), dim=-1)))
        return Encoding(feature, contact=self.contact(feature)[:, 0], alignment=self.alignment(feature)[:, 0])
