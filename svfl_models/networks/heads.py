"""Heads that map features to an offset, a distribution of actions or a value.

Each output transforms under the group as the physical quantity that it stands for.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.symmetry import OFFSET_PARTS
from svfl_models.networks.action_space import PLANAR, ActionSpace
from svfl_models.networks.baselines import PlainLayers
from svfl_models.networks.layer_factory import Layers, T
from svfl_models.networks.squashed_gaussian import SquashedGaussian
from svfl_models.symmetry.representations import physical, stored

LOG_SIGMA = (-20.0, 2.0)
"""Bounds to which the logarithm of a standard deviation is clamped, as in the reference implementation."""
NARROWEST = 8
"""Least number of units of an actor's hidden layer. With two units, ReLUs died: an actor cloned from 50 demonstrations
gave one constant action whenever the gripper was shut."""


class OffsetHead(nn.Module):
    """Head that predicts an offset: a vector in the plane, in image-aligned axes, [m].

    Args:
        layers: Layer factory that the head is built from.
        hidden: Type of the features that the head takes.
    """

    scale: Tensor

    def __init__(self, layers: Layers[T], hidden: T) -> None:
        super().__init__()
        self.map = layers.linear(hidden, layers.vector(OFFSET_PARTS))
        self.register_buffer("scale", torch.ones(()))

    def fit(self, offset: Tensor) -> None:
        """Set the scale of the output to the root mean square of the training offsets.

        Args:
            offset: Offsets of the training samples, shape (S, 2), [m].
        """
        self.scale.copy_(offset.square().mean().sqrt())

    def forward(self, features: Tensor) -> Tensor:
        """Map features, shape (B, C), to offsets, shape (B, 2), [m]."""
        return self.scale * physical(OFFSET_PARTS, self.map(features))


class Actor(nn.Module):
    """Head of three linear maps that gives a distribution of actions.

    Each hidden layer is half as wide as the layer before it, but has at least `NARROWEST` units. The mean consists of
    the parts of the action. The components of a vector, such as dx and dy, share one standard deviation, which is
    invariant: two separate ones would have to change places when the scene is rotated by a quarter turn, which
    invariants cannot do (see `squashed_gaussian`).

    Args:
        layers: Layer factory that the actor is built from.
        latent: Number of units of the features.
        space: Parts and bounds of the action; by default those of the paper's planar action.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> actor = Actor(layer_factory(GROUPS["D4"]), latent=8)
        >>> actor(torch.randn(2, 64)).mode.shape
        torch.Size([2, 5])
    """

    def __init__(self, layers: Layers[T], latent: int, space: ActionSpace = PLANAR) -> None:
        super().__init__()
        self.space = space
        widths = (latent, max(latent // 2, NARROWEST), max(latent // 4, NARROWEST))
        hidden = [layers.hidden(width) for width in widths]
        self.maps = nn.ModuleList(
            layers.linear(*types) for types in pairwise([*hidden, layers.vector(space.policy_parts)])
        )

    def forward(self, features: Tensor) -> SquashedGaussian:
        """Map features, shape (B, C), to one distribution of actions per sample, in image-aligned axes."""
        *hidden, last = self.maps
        x = features
        for linear in hidden:
            x = functional.relu(linear(x))
        policy, count = physical(self.space.policy_parts, last(x)), len(self.space)
        deviations = policy[:, [count + number for number in self.space.deviation_of]]
        return SquashedGaussian(policy[:, :count], deviations.clamp(*LOG_SIGMA), self.space)


class Critic(nn.Module):
    """Head that gives two values of an action, which do not change when world and action are rotated together.

    Args:
        layers: Layer factory that the critic is built from.
        latent: Number of units of the features.
        space: Parts and bounds of the action; by default those of the paper's planar action.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> critic = Critic(layer_factory(GROUPS["D4"]), latent=8)
        >>> critic(torch.randn(2, 64), torch.randn(2, 5)).shape
        torch.Size([2, 2])
    """

    def __init__(self, layers: Layers[T], latent: int, space: ActionSpace = PLANAR) -> None:
        super().__init__()
        self.space = space
        hidden = layers.hidden(latent)
        source = layers.joined([hidden, layers.vector(space.parts)])
        self.maps = nn.ModuleList(layers.linear(source, hidden) for _ in range(2))
        self.values = nn.ModuleList(PlainLayers().linear(latent, 1) for _ in range(2))
        self.copies = layers.copies

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        """Return both values of each action.

        Args:
            features: Features of the observations, shape (B, C).
            action: Actions in physical units, shape (B, C), in image-aligned axes.

        Returns:
            Two values per sample, shape (B, 2).
        """
        x = torch.cat([features, stored(self.space.parts, self.space.to_unit(action))], dim=-1)
        values = []
        for linear, value in zip(self.maps, self.values, strict=True):
            invariant = functional.relu(linear(x)).unflatten(-1, (-1, self.copies)).amax(dim=-1)  # (B, units)
            values.append(value(invariant))
        return torch.cat(values, dim=-1)
