"""Block centering: from image and wrench window to where the hand must move."""

import torch
from torch import Tensor, nn

from svfl_data.centering import CenteringSamples
from svfl_data.errors import TrainingError
from svfl_models.config import ENCODERS, IMAGE_SIZES, TARGETS
from svfl_models.groups import GROUPS, group_named
from svfl_models.heads import OffsetHead
from svfl_models.kits import Layers, kit
from svfl_models.presets import PRESETS
from svfl_models.visual_force import Batch, VisualForceEncoder


class CenteringClassifier(nn.Module):
    """Encoders, fusion, and scores of the four directions, or the offset itself.

    Args:
        encoder: ``v`` (image), ``f`` (wrench window) or ``vf`` (both).
        group: Symmetry group, one of `groups.GROUPS`; ``none`` builds the plain twin.
        preset: Sizes, one of `presets.PRESETS`.
        target: ``direction`` (scores of four classes) or ``offset`` (where the block's centre is, in metres).
        image_size: Height and width of the images, one of `config.IMAGE_SIZES`, [px].
        window: Readings T per wrench window.
        torque: ``axial``, or the paper's ``polar`` (see `representations.wrench_parts`).

    Raises:
        TrainingError: If an argument is not one of its possible values.
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
    ) -> None:
        super().__init__()
        _check("encoder", encoder, ENCODERS)
        _check("preset", preset, tuple(PRESETS))
        _check("target", target, TARGETS)
        _check("image size", image_size, IMAGE_SIZES)
        self.group, self.target = group_named(group), target
        layers: Layers = kit(self.group)
        widths = PRESETS[preset]["cnn" if self.group == GROUPS["none"] else "svfl"]
        self.trunk = VisualForceEncoder(layers, widths, encoder, image_size, window, torque)
        hidden = layers.hidden(widths.latent)
        self.head = layers.scores(hidden) if target == "direction" else OffsetHead(layers, hidden)

    def fit(self, samples: CenteringSamples) -> None:
        """Take the statistics of training samples: scales of the inputs, and of offsets where they are the output."""
        self.trunk.normalization.fit(image=samples.image, wrench=samples.wrench)
        if isinstance(self.head, OffsetHead):
            self.head.fit(torch.from_numpy(samples.offset))

    def forward(self, batch: Batch) -> Tensor:
        """Scores of the directions (B, 4), order of `svfl_data.symmetry.DIRECTIONS`; or offsets (B, 2), [m].

        Both in image-aligned axes.

        Raises:
            TrainingError: If an input is missing or has a shape that the network was not built for.
        """
        return self.head(self.trunk(batch))


def parameter_count(module: nn.Module) -> int:
    """Number of learned numbers."""
    return sum(parameter.numel() for parameter in module.parameters() if parameter.requires_grad)


def _check(what: str, value: object, possible: tuple[object, ...]) -> None:
    if value not in possible:
        raise TrainingError(f"unknown {what} {value!r}; possible: {', '.join(map(str, possible))}")
