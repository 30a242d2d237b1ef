"""Network for block centering: it maps an image and a wrench window to the direction in which the gripper must move."""

from typing import Any

import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_models.centering.config import TARGETS
from svfl_models.centering.data import Crops
from svfl_models.centering.latent_trunk import LatentTrunk
from svfl_models.networks.heads import OffsetHead
from svfl_models.networks.inputs import CROP, ENCODERS, IMAGE_SIZES, INPUTS
from svfl_models.networks.layer_factory import Layers, layer_factory
from svfl_models.networks.presets import Widths, widths_of
from svfl_models.networks.visual_force import VisualForceEncoder
from svfl_models.symmetry.actions import Batch
from svfl_models.symmetry.groups import group_named

LATENT_INPUTS = "vfp"


class CenteringClassifier(nn.Module):
    """Encoders and their fusion, followed by scores of the four directions or by the offset itself.

    Args:
        encoder: Inputs of the network: ``v`` (image), ``f`` (wrench window) or ``vf`` (both); ``vfp`` (both and
            proprioception) with `latent_network`.
        group: Name of the symmetry group, a key of `groups.GROUPS`; ``none`` builds the parameter-matched CNN baseline.
        preset: Name of the layer sizes, a key of `presets.PRESETS`, unless `widths` are given.
        target: Output of the network: ``direction`` (scores of four classes) or ``offset`` (displacement that centres
            the gripper over the block, in metres).
        image_size: Height and width of the images, one of `networks.inputs.IMAGE_SIZES`, [px].
        window: Number T of readings per wrench window.
        torque: How torques transform under reflections: ``axial``, or ``polar`` as in the paper (see
            `representations.wrench_parts`).
        latent_network: Arguments of a `LatentTrunk` that replaces the encoders and their fusion. It needs the encoder
            ``vfp``, the group ``none``, and its own image size and window; `preset` and `torque` have no effect then.
            None builds the package's own encoders.
        widths: Sizes of the layers as plain values (`presets.Widths.plain`), in the place of `preset`.
        crop: Share of the camera image's side that the images show, see `image_crops.crop_side`.

    Raises:
        TrainingError: If an argument is not one of its possible values.

    Example:
        >>> network = CenteringClassifier("f", preset="tiny")
        >>> network({"wrench": torch.randn(3, 64, 6)}).shape
        torch.Size([3, 4])
    """

    def __init__(
        self,
        encoder: str = "vf",
        group: str = "D4",
        preset: str = "default",
        target: str = "direction",
        image_size: int = 64,
        window: int = 64,
        torque: str = "axial",
        latent_network: dict[str, Any] | None = None,
        widths: dict[str, Any] | None = None,
        crop: float = CROP,
    ) -> None:
        super().__init__()
        _check("encoder", encoder, (LATENT_INPUTS,) if latent_network else ENCODERS)
        _check("target", target, TARGETS)
        _check("image size", image_size, IMAGE_SIZES)
        self.group, self.target = group_named(group), target
        layers: Layers = layer_factory(self.group)
        self.trunk: VisualForceEncoder | LatentTrunk
        if latent_network:
            _check("group of a latent encoder", group, ("none",))
            _check("image size of a latent encoder", image_size, (LatentTrunk.image_size,))
            _check("window of a latent encoder", window, (LatentTrunk.window,))
            self.trunk = LatentTrunk(**latent_network)
            hidden = layers.hidden(self.trunk.width)
        else:
            sizes = widths_of(preset, group) if widths is None else Widths.of_plain(widths)
            self.trunk = VisualForceEncoder(layers, sizes, encoder, image_size, window, torque, crop)
            hidden = layers.hidden(sizes.latent)
        self.head = layers.scores(hidden) if target == "direction" else OffsetHead(layers, hidden)

    def fit(self, samples: CenteringSamples) -> None:
        """Take the scales of the inputs, and that of the offsets if these are the output, from training samples.

        A latent encoder keeps the input scales of its pretraining; only the scales of its features are taken here.

        Args:
            samples: The training samples.
        """
        if isinstance(self.trunk, LatentTrunk):
            self.trunk.fit(Crops(samples, INPUTS[LATENT_INPUTS], self.trunk.image_size)[list(range(len(samples)))])
        else:
            self.trunk.normalization.fit(image=samples.image if samples.image.size else None, wrench=samples.wrench)
        if isinstance(self.head, OffsetHead):
            self.head.fit(torch.from_numpy(samples.offset))

    def forward(self, batch: Batch) -> Tensor:
        """Return the scores of the directions, shape (B, 4), or the offsets, shape (B, 2), [m], in image-aligned axes.

        The scores are in the order of `svfl_data.symmetry.DIRECTIONS`.

        Raises:
            TrainingError: If an input is missing or has a shape that the network was not built for.
        """
        return self.head(self.trunk(batch))


def _check(what: str, value: object, possible: tuple[object, ...]) -> None:
    if value not in possible:
        raise TrainingError(f"unknown {what} {value!r}; possible: {', '.join(map(str, possible))}")
