"""Block centering: from image and wrench window to the direction in which the hand must move."""

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.baselines import PlainLayers
from svfl_models.config import ENCODERS, MODELS
from svfl_models.encoders import IMAGE_SIZE, ForceEncoder, Fusion, VisionEncoder
from svfl_models.layers import Layers, SymmetricLayers
from svfl_models.normalization import Normalization
from svfl_models.presets import PRESETS
from svfl_models.representations import wrench_parts

Batch = dict[str, Tensor]
"""``image`` (B, 4, 64, 64): colour / 255, depth in [m]. ``wrench`` (B, T, 6), [N] and [N m]. Image-aligned axes."""


class CenteringClassifier(nn.Module):
    """Encoders, fusion, and scores of the four directions.

    Args:
        encoder: ``v`` (image), ``f`` (wrench window) or ``vf`` (both).
        model: ``svfl`` (equivariant to D4) or ``cnn`` (its plain twin).
        preset: Sizes, one of `presets.PRESETS`.
        window: Readings T per wrench window.
        torque: ``axial``, or the paper's ``polar`` (see `representations.wrench_parts`).

    Raises:
        TrainingError: If an argument is not one of its possible values.
    """

    def __init__(
        self,
        encoder: str = "vf",
        model: str = "svfl",
        preset: str = "default",
        window: int = 64,
        torque: str = "axial",
    ) -> None:
        super().__init__()
        _check("encoder", encoder, ENCODERS)
        _check("model", model, MODELS)
        _check("preset", preset, tuple(PRESETS))
        self.window = window
        self.normalization = Normalization()
        layers: Layers = SymmetricLayers() if model == "svfl" else PlainLayers()
        widths = PRESETS[preset][model]
        self.vision = VisionEncoder(layers, widths.vision, widths.latent) if "v" in encoder else None
        self.force = (
            ForceEncoder(layers, wrench_parts(torque), window, widths.force, widths.heads, widths.latent)
            if "f" in encoder
            else None
        )
        self.fusion = Fusion(layers, len(encoder), widths.latent)
        self.head = layers.linear(layers.hidden(widths.latent), layers.directions())

    def features(self, batch: Batch) -> Tensor:
        """Fused hidden features (B, C), before the head."""
        features = []
        if self.vision is not None:
            features.append(self.vision(self.normalization.image(_expect(batch, "image", (4, IMAGE_SIZE, IMAGE_SIZE)))))
        if self.force is not None:
            features.append(self.force(self.normalization.wrench(_expect(batch, "wrench", (self.window, 6)))))
        return self.fusion(features)

    def forward(self, batch: Batch) -> Tensor:
        """Scores of the directions (B, 4), order of `svfl_data.symmetry.DIRECTIONS`.

        Raises:
            TrainingError: If an input is missing or has a shape that the network was not built for.
        """
        return self.head(self.features(batch))


def parameter_count(module: nn.Module) -> int:
    """Number of learned numbers."""
    return sum(parameter.numel() for parameter in module.parameters() if parameter.requires_grad)


def _expect(batch: Batch, name: str, shape: tuple[int, ...]) -> Tensor:
    if name not in batch:
        raise TrainingError(f"the batch has no {name!r}; it has {', '.join(sorted(batch))}")
    if tuple(batch[name].shape[1:]) != shape:
        found = tuple(batch[name].shape)
        raise TrainingError(f"{name!r} has shape {found}; this network was built for (B, {', '.join(map(str, shape))})")
    return batch[name]


def _check(what: str, value: str, possible: tuple[str, ...]) -> None:
    if value not in possible:
        raise TrainingError(f"unknown {what} {value!r}; possible: {', '.join(possible)}")
