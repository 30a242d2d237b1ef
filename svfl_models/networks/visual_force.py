"""From what was seen, felt and known of the gripper to one vector of features: the trunk of every network here."""

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.networks.encoders import IMAGE_CHANNELS, ForceEncoder, Fusion, ProprioEncoder, VisionEncoder
from svfl_models.networks.layer_factory import Layers
from svfl_models.networks.normalization import Normalization
from svfl_models.networks.presets import Widths
from svfl_models.symmetry.representations import wrench_parts

Batch = dict[str, Tensor]
"""Vectors in image-aligned axes. ``image`` (B, 4, H, H): colour / 255, depth in [m]. ``wrench`` (B, T, 6), [N] and
[N m]. ``proprio`` (B, 5): gripper opening 0..1, x and y relative to the workspace centre and z [m], yaw [rad]."""


class VisualForceEncoder(nn.Module):
    """An encoder for each input, and their fusion.

    Args:
        layers: The layer factory to build from; it decides on the symmetry.
        widths: Sizes.
        inputs: Which: ``v`` image, ``f`` wrench window, ``p`` proprioception, or several, e.g. ``vfp``.
        image_size: Height and width of the images, [px].
        window: Readings T per wrench window.
        torque: ``axial``, or the paper's ``polar`` (see `representations.wrench_parts`).

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
        inputs: str = "vf",
        image_size: int = 64,
        window: int = 64,
        torque: str = "axial",
    ) -> None:
        super().__init__()
        self.image_size, self.window = image_size, window
        self.normalization = Normalization()
        latent = widths.latent
        self.vision = VisionEncoder(layers, widths.vision, latent, image_size) if "v" in inputs else None
        self.force = (
            ForceEncoder(layers, wrench_parts(torque), window, widths.force, widths.heads, latent)
            if "f" in inputs
            else None
        )
        self.proprio = ProprioEncoder(layers, widths.proprio, latent) if "p" in inputs else None
        self.fusion = Fusion(layers, len(inputs), latent)

    def forward(self, batch: Batch) -> Tensor:
        """Features (B, C), hidden units of the layer factory.

        Raises:
            TrainingError: If an input is missing or has a shape that the network was not built for.
        """
        features = []
        if self.vision is not None:
            image = _expect(batch, "image", (IMAGE_CHANNELS, self.image_size, self.image_size))
            features.append(self.vision(self.normalization.image(image)))
        if self.force is not None:
            features.append(self.force(self.normalization.wrench(_expect(batch, "wrench", (self.window, 6)))))
        if self.proprio is not None:
            features.append(self.proprio(self.normalization.proprio(_expect(batch, "proprio", (5,)))))
        return self.fusion(features)


def _expect(batch: Batch, name: str, shape: tuple[int, ...]) -> Tensor:
    if name not in batch:
        raise TrainingError(f"the batch has no {name!r}; it has {', '.join(sorted(batch))}")
    if tuple(batch[name].shape[1:]) != shape:
        found = tuple(batch[name].shape)
        raise TrainingError(f"{name!r} has shape {found}; this network was built for (B, {', '.join(map(str, shape))})")
    return batch[name]
