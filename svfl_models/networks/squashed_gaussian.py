"""What an actor says: a Gaussian, squashed by a hyperbolic tangent into the bounds of an action.

An action is ``centre + scale * tanh(u)`` with u normal, component by component (Haarnoja et al., ICML 2018, appendix
C). A tanh of each component commutes with what permutes the components and changes their signs, and with nothing else:
the square of permitted (dx, dy) is mapped onto itself by quarter turns and flips only. So the distribution of a
symmetric actor is symmetric under the pixel-exact part of its group, C4 or D4; at the angles between, only mean and
deviations before the tanh are. The deviations of dx and dy must be one number: a quarter turn exchanges dx and dy, and
the distribution of a turned world's actions must be the turned distribution.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

CENTRE = (0.5, 0.0, 0.0, 0.0, 0.0)
SCALE = (0.5, 0.025, 0.025, 0.025, math.pi / 16)
"""Bounds, centre +- scale: gripper opening 0..1, dx, dy, dz [m], dtheta [rad] (Kohler et al., CoRL 2023, section 5)."""

INSIDE = 1 - 1e-6
"""An action on its bounds, such as a closed gripper, counts as this far out: at the bound itself u is infinite."""


def to_unit(action: Tensor) -> Tensor:
    """Physical actions (..., 5) -> -1..1 in every component. Commutes with the group: dx and dy share a scale."""
    return (action - action.new_tensor(CENTRE)) / action.new_tensor(SCALE)


def to_physical(unit: Tensor) -> Tensor:
    """The inverse of `to_unit`: (..., 5) -> gripper opening 0..1, dx, dy, dz [m], dtheta [rad]."""
    return unit.new_tensor(CENTRE) + unit.new_tensor(SCALE) * unit


@dataclass(frozen=True, eq=False)
class SquashedGaussian:
    """A distribution of actions, independent in every component.

    Attributes:
        mean: Of u, order of `svfl_data.symmetry.ACTION_PARTS`, shape (B, 5).
        log_sigma: Logarithm of the deviations of u, shape (B, 5); dx and dy have the same.
    """

    mean: Tensor
    log_sigma: Tensor

    @property
    def mode(self) -> Tensor:
        """The action of the mean, (B, 5): what to do when not exploring."""
        return to_physical(torch.tanh(self.mean))

    def sample(self, noise: Tensor | None = None) -> Tensor:
        """Draw one action each, differentiable in mean and deviation.

        Args:
            noise: Standard normal, shape (B, 5); drawn if not given.

        Returns:
            Shape (B, 5).
        """
        return self.sample_with_log_prob(noise)[0]

    def sample_with_log_prob(self, noise: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Like `sample`, with the logarithm of each action's density, shape (B,), exact however far out it lies."""
        if noise is None:
            noise = torch.randn_like(self.mean)
        u = self.mean + self.log_sigma.exp() * noise
        return to_physical(torch.tanh(u)), self._log_density(u, noise)

    def log_prob(self, action: Tensor) -> Tensor:
        """Logarithm of the density of actions, per unit of their components.

        Args:
            action: Shape (B, 5), within the bounds.

        Returns:
            Shape (B,).
        """
        u = torch.atanh(to_unit(action).clamp(-INSIDE, INSIDE))
        return self._log_density(u, (u - self.mean) / self.log_sigma.exp())

    def _log_density(self, u: Tensor, noise: Tensor) -> Tensor:
        normal = -0.5 * noise.square() - self.log_sigma - 0.5 * math.log(2 * math.pi)
        log_slope = 2 * (math.log(2) - u - functional.softplus(-2 * u))  # log(1 - tanh(u)^2), which underflows
        return (normal - log_slope - u.new_tensor(SCALE).log()).sum(dim=-1)
