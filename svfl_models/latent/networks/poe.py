"""Product of experts: each modality gives a Gaussian of the feature, and their product is the joint distribution."""

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODALITIES, Sizes
from svfl_models.latent.inputs import PROPRIO
from svfl_models.latent.networks.encoder import Encoder, Encoding, Parts
from svfl_models.latent.networks.gaussian import Gaussian, product
from svfl_models.latent.networks.portion import Portion
from svfl_models.latent.networks.trunks import ImageTrunk, WrenchTrunk, perceptron


class PoEEncoder(Encoder):
    """Encoder with one expert per modality, times the prior N(0, I) (Lee et al., T-RO 2020; VTT's published PoE).

    Any of the modalities may be missing; the product is then over the experts of the others. The feature is a random
    draw in training and the mean in evaluation, both followed by a layer norm.

    Args:
        sizes: Layer sizes of the networks.
    """

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        claims = 2 * sizes.feature
        self.trunks = nn.ModuleDict(
            {
                "image": ImageTrunk(sizes.image, claims),
                "wrench": WrenchTrunk(sizes.wrench, claims),
                "proprio": perceptron(PROPRIO, sizes.proprio, claims),
            }
        )
        self.norm = nn.LayerNorm(sizes.feature)
        self.contact = nn.Linear(sizes.feature, 1)
        self.alignment = nn.Linear(sizes.feature, 1)

    def part(self, name: str, values: Tensor) -> Tensor:
        """Return the raw mean and variance of an expert, shape (B, 2 F)."""
        part: Tensor = self.trunks[name](values)
        return part

    def experts(self, parts: Parts) -> dict[str, Gaussian]:
        """Return the distribution of each expert by modality, and that of the prior as ``prior``.

        Raises:
            TrainingError: If there is no modality at all.
        """
        if not parts:
            raise TrainingError(f"no modality is given; there are {', '.join(MODALITIES)}")
        claimed = {name: Gaussian.of(numbers) for name, numbers in parts.items()}
        return {**claimed, "prior": Gaussian.standard_like(next(iter(claimed.values())).mean)}

    def join(self, parts: Parts, portion: Portion | None = None) -> Encoding:
        """Multiply the distributions of the experts and compute the outputs from the product."""
        posterior = product(list(self.experts(parts).values()))
        feature = self.norm(posterior.sample(portion) if self.training else posterior.mean)
        contact, alignment = self.contact(feature)[:, 0], self.alignment(feature)[:, 0]
        return Encoding(feature, contact=contact, alignment=alignment, posterior=posterior)
