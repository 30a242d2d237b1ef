"""What a network says about its features: an offset, an action, a value. Each transforms as the thing it names."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.symmetry import ACTION_PARTS, OFFSET_PARTS, Part
from svfl_models.networks.baselines import PlainLayers
from svfl_models.networks.layer_factory import Layers, T
from svfl_models.networks.squashed_gaussian import SquashedGaussian, to_unit
from svfl_models.symmetry.representations import physical, stored

POLICY_PARTS = (*ACTION_PARTS, Part("invariant", (5, 6, 7, 8)))
"""Mean of an action before squashing, then the logarithms of its deviations: gripper, dx and dy, dz, dtheta."""
DEVIATION_OF = [5, 6, 6, 7, 8]
"""Where in `POLICY_PARTS` each component of an action has its own."""
LOG_SIGMA = (-20.0, 2.0)
"""Least and most (the reference implementation's)."""
NARROWEST = 8
"""Units of an actor's hidden layer, at least. With two, ReLUs died: whenever the gripper was shut, an actor cloned from
50 demonstrations said one constant action."""


class OffsetHead(nn.Module):
    """A vector in the plane, in metres.

    Args:
        layers: The layer factory to build from.
        hidden: Type of the features.
    """

    scale: Tensor

    def __init__(self, layers: Layers[T], hidden: T) -> None:
        super().__init__()
        self.map = layers.linear(hidden, layers.vector(OFFSET_PARTS))
        self.register_buffer("scale", torch.ones(()))

    def fit(self, offset: Tensor) -> None:
        """Take the scale from training offsets, shape (S, 2), [m]."""
        self.scale.copy_(offset.square().mean().sqrt())

    def forward(self, features: Tensor) -> Tensor:
        """(B, C) -> (B, 2), [m]."""
        return self.scale * physical(OFFSET_PARTS, self.map(features))


class Actor(nn.Module):
    """Three maps, each hidden layer half as wide as the one before (`NARROWEST`), to a distribution of actions.

    (dx, dy) is a vector, dtheta a pseudoscalar, the rest invariant. dx and dy share their deviation, an invariant: two
    of their own would change places in a turned world, which invariants cannot (`squashed_gaussian`).

    Args:
        layers: The layer factory to build from.
        latent: Units of the features.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> actor = Actor(layer_factory(GROUPS["D4"]), latent=8)
        >>> actor(torch.randn(2, 64)).mode.shape
        torch.Size([2, 5])
    """

    def __init__(self, layers: Layers[T], latent: int) -> None:
        super().__init__()
        widths = (latent, max(latent // 2, NARROWEST), max(latent // 4, NARROWEST))
        hidden = [layers.hidden(width) for width in widths]
        self.maps = nn.ModuleList(layers.linear(*types) for types in pairwise([*hidden, layers.vector(POLICY_PARTS)]))

    def forward(self, features: Tensor) -> SquashedGaussian:
        """Features (B, C) -> a distribution of actions for each."""
        *hidden, last = self.maps
        x = features
        for linear in hidden:
            x = functional.relu(linear(x))
        policy = physical(POLICY_PARTS, last(x))
        return SquashedGaussian(policy[:, : len(DEVIATION_OF)], policy[:, DEVIATION_OF].clamp(*LOG_SIGMA))


class Critic(nn.Module):
    """Two values of an action, which do not change when the world and the action are rotated together.

    Args:
        layers: The layer factory to build from.
        latent: Units of the features.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> critic = Critic(layer_factory(GROUPS["D4"]), latent=8)
        >>> critic(torch.randn(2, 64), torch.randn(2, 5)).shape
        torch.Size([2, 2])
    """

    def __init__(self, layers: Layers[T], latent: int) -> None:
        super().__init__()
        hidden = layers.hidden(latent)
        source = layers.joined([hidden, layers.vector(ACTION_PARTS)])
        self.maps = nn.ModuleList(layers.linear(source, hidden) for _ in range(2))
        self.values = nn.ModuleList(PlainLayers().linear(latent, 1) for _ in range(2))
        self.copies = layers.copies

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        """Both values.

        Args:
            features: Shape (B, C).
            action: Shape (B, 5): gripper opening 0..1, dx, dy, dz [m], dtheta [rad], image-aligned axes.

        Returns:
            Shape (B, 2).
        """
        x = torch.cat([features, stored(ACTION_PARTS, to_unit(action))], dim=-1)
        values = []
        for linear, value in zip(self.maps, self.values, strict=True):
            invariant = functional.relu(linear(x)).unflatten(-1, (-1, self.copies)).amax(dim=-1)  # (B, units)
            values.append(value(invariant))
        return torch.cat(values, dim=-1)
