"""The trunk of every network here: it maps the camera image, wrench window and proprioception to one feature vector."""

from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.networks.encoders import IMAGE_CHANNELS, ForceEncoder, Fusion, ProprioEncoder, VisionEncoder
from svfl_models.networks.layer_factory import Layers
from svfl_models.networks.normalization import Normalization
from svfl_models.networks.presets import Widths
from svfl_models.symmetry.representations import wrench_parts

Batch = dict[str, Tensor]
"""Inputs of a network by name, with vectors in image-aligned axes. ``image`` (B, 4, H, H): colour / 255, then depth in
[m]. ``wrench`` (B, T, 6): force [N], then torque [N m]. ``proprio`` (B, 5): gripper opening 0..1, x and y relative to
the workspace centre and z [m], yaw [rad]."""


class VisualForceEncoder(nn.Module):
    """Network of one encoder for each input, and their fusion.

    Args:
        layers: Layer factory that the network is built from, which decides whether the network is symmetric.
        widths: Numbers of units of each part of the network.
        inputs: Inputs of the network: ``v`` image, ``f`` wrench window, ``p`` proprioception, or several, e.g. ``vfp``.
        image_size: Height and width of the images, one of `inputs.IMAGE_SIZES`, [px].
        window: Number of readings T per wrench window.
        torque: How a torque transforms: ``axial``, or the paper's ``polar`` (see `representations.wrench_parts`).

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
        """Return the fused features of a batch.

        Args:
            batch: Inputs of the network in physical units, which the network normalises. Other entries are ignored.

        Returns:
            Features of the layer factory's hidden type, shape (B, C).

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
