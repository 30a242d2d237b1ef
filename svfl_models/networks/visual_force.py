"""The trunk of every network here: it maps images, windows of readings and vectors to one feature vector."""

from collections.abc import Sequence

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.networks.encoders import ForceEncoder, Fusion, InvariantVision, VectorEncoder, VisionEncoder
from svfl_models.networks.input_types import ImageInput, NetworkInput, SequenceInput, paper_inputs
from svfl_models.networks.inputs import CROP
from svfl_models.networks.layer_factory import Layers
from svfl_models.networks.normalization import Normalization
from svfl_models.networks.presets import Widths
from svfl_models.symmetry.actions import Batch


class VisualForceEncoder(nn.Module):
    """Network of one encoder for each input, and their fusion.

    Args:
        layers: Layer factory that the network is built from, which decides whether the network is symmetric.
        widths: Numbers of units of each part of the network.
        inputs: Inputs of the network (`input_types`), or the short names of the paper's: ``v`` image, ``f`` wrench
            window, ``p`` proprioception, or several, e.g. ``vfp``.
        image_size: Height and width of the images, one of `inputs.IMAGE_SIZES`, [px].
        window: Number of readings T per wrench window, if the inputs are given by short names.
        torque: How a torque transforms, if the inputs are given by short names: ``axial``, or the paper's ``polar``
            (see `representations.wrench_parts`).
        crop: Share of the camera image's side that the images show, which is kept for those who cut them
            (`image_crops.crop_side`).

    Raises:
        TrainingError: If there is no input, or two have the same name.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> from svfl_models.networks.presets import PRESETS
        >>> encoder = VisualForceEncoder(layer_factory(GROUPS["D4"]), PRESETS["tiny"]["svfl"], inputs="f")
        >>> encoder({"wrench": torch.randn(2, 64, 6)}).dim()
        2
    """

    def __init__(
        self,
        layers: Layers,
        widths: Widths,
        inputs: str | Sequence[NetworkInput] = "vf",
        image_size: int = 64,
        window: int = 64,
        torque: str = "axial",
        crop: float = CROP,
    ) -> None:
        super().__init__()
        given = paper_inputs(inputs, window, torque) if isinstance(inputs, str) else tuple(inputs)
        self.inputs = {one.name: one for one in given}
        if not given or len(self.inputs) < len(given):
            raise TrainingError(f"a network needs inputs with different names, got {[one.name for one in given]}")
        self.image_size, self.window, self.crop = image_size, window, crop
        self.normalization = Normalization(given)
        self.encoders = nn.ModuleList(_encoder(one, layers, widths, image_size) for one in given)
        self.fusion = Fusion(layers, len(given), widths.latent)

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an input without the batch dimension.

        Args:
            name: Name of the input.
        """
        one = self.inputs[name]
        if isinstance(one, ImageInput):
            return (one.channels, self.image_size, self.image_size)
        components = sum(len(part.index) for part in one.parts)
        return (one.length, components) if isinstance(one, SequenceInput) else (components,)

    def forward(self, batch: Batch) -> Tensor:
        """Return the fused features of a batch.

        Args:
            batch: Inputs of the network in physical units, which the network normalises. Other entries are ignored.

        Returns:
            Features of the layer factory's hidden type, shape (B, C).

        Raises:
            TrainingError: If an input is missing or has a shape that the network was not built for.
        """
        features = []
        for name, encoder in zip(self.inputs, self.encoders, strict=True):
            values = _expect(batch, name, self.shape(name))
            features.append(encoder(self.normalization.scaled(name, values)))
        return self.fusion(features)


def _encoder(one: NetworkInput, layers: Layers, widths: Widths, image_size: int) -> nn.Module:
    if isinstance(one, ImageInput):
        kind = VisionEncoder if one.moves == "pixels" else InvariantVision
        return kind(layers, widths.vision, widths.latent, image_size, one.channels)
    if isinstance(one, SequenceInput):
        return ForceEncoder(layers, one.parts, one.length, widths.force, widths.heads, widths.latent)
    return VectorEncoder(layers, widths.proprio, widths.latent, one.parts)


def _expect(batch: Batch, name: str, shape: tuple[int, ...]) -> Tensor:
    if name not in batch:
        raise TrainingError(f"the batch has no {name!r}; it has {', '.join(sorted(batch))}")
    if tuple(batch[name].shape[1:]) != shape:
        found = tuple(batch[name].shape)
        raise TrainingError(f"{name!r} has shape {found}; this network was built for (B, {', '.join(map(str, shape))})")
    return batch[name]
