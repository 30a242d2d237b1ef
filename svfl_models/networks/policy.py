"""A policy, which maps the camera image, wrench window and proprioception to a distribution of actions."""

from collections.abc import Sequence
from typing import Any

from torch import nn

from svfl_data.sampling.windows import WINDOW
from svfl_models.networks.action_space import PLANAR, ActionSpace
from svfl_models.networks.heads import Actor
from svfl_models.networks.input_types import inputs_of_plain
from svfl_models.networks.inputs import CROP
from svfl_models.networks.layer_factory import Layers, layer_factory
from svfl_models.networks.presets import Widths, widths_of
from svfl_models.networks.squashed_gaussian import SquashedGaussian
from svfl_models.networks.visual_force import VisualForceEncoder
from svfl_models.symmetry.actions import Batch
from svfl_models.symmetry.groups import group_named


class Policy(nn.Module):
    """Policy network of a trunk and an actor (Kohler et al., CoRL 2023, section 4), symmetric or plain.

    Args:
        encoder: Inputs of the policy by the short names of the paper's: ``v`` image, ``f`` wrench window, ``p``
            proprioception, or several, e.g. ``vfp``.
        group: Name of the symmetry group, one of `groups.GROUPS`; ``none`` builds the parameter-matched CNN baseline.
        preset: Name of the network's sizes, one of `presets.PRESETS`, unless `widths` are given.
        image_size: Height and width of the images, one of `inputs.IMAGE_SIZES`, [px].
        window: Number of readings T per wrench window.
        inputs: Inputs of the policy as plain values (`input_types.plain_inputs`), in the place of `encoder`. None for
            the paper's inputs.
        action: Parts and bounds of the action as plain values (`ActionSpace.plain`). None for the paper's planar
            action.
        widths: Sizes of the layers as plain values (`presets.Widths.plain`), in the place of `preset`.
        crop: Share of the camera image's side that the images show, see `image_crops.crop_side`.

    Raises:
        TrainingError: If there is no such group or preset, or inputs or action cannot be read.

    Example:
        >>> policy = Policy("fp", preset="tiny")
        >>> policy({"wrench": torch.randn(2, 64, 6), "proprio": torch.randn(2, 5)}).mode.shape
        torch.Size([2, 5])
    """

    def __init__(
        self,
        encoder: str = "vfp",
        group: str = "D4",
        preset: str = "default",
        image_size: int = 64,
        window: int = WINDOW,
        inputs: Sequence[dict[str, Any]] | None = None,
        action: dict[str, Any] | None = None,
        widths: dict[str, Any] | None = None,
        crop: float = CROP,
    ) -> None:
        super().__init__()
        self.group = group_named(group)
        layers: Layers = layer_factory(self.group)
        sizes = widths_of(preset, group) if widths is None else Widths.of_plain(widths)
        given = encoder if inputs is None else inputs_of_plain(inputs)
        self.trunk = VisualForceEncoder(layers, sizes, given, image_size, window, crop=crop)
        self.actor = Actor(layers, sizes.latent, PLANAR if action is None else ActionSpace.of_plain(action))

    def forward(self, batch: Batch) -> SquashedGaussian:
        """Return the distribution of actions for each sample of a batch, in image-aligned axes.

        The mean before squashing is equivariant under the whole group, as far as images are. The distribution of
        actions is equivariant under the part of the group that maps pixels onto pixels (see
        `svfl_models.networks.squashed_gaussian`).

        Args:
            batch: Inputs of the policy, see `visual_force.Batch`. Other entries are ignored.

        Raises:
            TrainingError: If an input is missing or has a shape that the network was not built for.
        """
        return self.actor(self.trunk(batch))
