"""The output of an actor: a Gaussian that a hyperbolic tangent squashes into the bounds of an action.

An action is ``centre + scale * tanh(u)``, where u is normal, component by component (Haarnoja et al., ICML 2018,
appendix C). The tanh of each component commutes with permutations and sign changes of the components, and with nothing
else: only quarter turns and flips map the square of permitted (dx, dy) onto itself. The distribution of a symmetric
actor is therefore symmetric under the pixel-exact part of its group, C4 or D4. Under the other elements only the mean
and the standard deviations before the tanh are symmetric. dx and dy must have the same standard deviation: a quarter
turn exchanges dx and dy, and the distribution of actions in a rotated scene must be the rotated distribution.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from svfl_models.networks.action_space import PLANAR, ActionSpace

INSIDE = 1 - 1e-6
"""Largest absolute value of a component in units of the bounds when its density is computed. An action on a bound, such
as a closed gripper, is clamped to this value, because u is infinite at the bound itself."""


@dataclass(frozen=True, eq=False)
class SquashedGaussian:
    """A distribution of actions for each sample, in which the components are independent of each other.

    Attributes:
        mean: Mean of u, the action before the tanh, shape (B, C).
        log_sigma: Natural logarithm of the standard deviations of u, shape (B, C); the components of a vector, such as
            dx and dy, have the same one.
        space: Parts and bounds of the action; by default those of the paper's planar action.
    """

    mean: Tensor
    log_sigma: Tensor
    space: ActionSpace = PLANAR

    @property
    def mode(self) -> Tensor:
        """The action that belongs to the mean, shape (B, C), which a policy takes when it does not explore."""
        return self.space.to_physical(torch.tanh(self.mean))

    def sample(self, noise: Tensor | None = None) -> Tensor:
        """Draw one action per sample, differentiable in mean and standard deviation.

        Args:
            noise: Standard normal numbers, shape (B, C). None means that they are drawn.

        Returns:
            Actions in physical units, shape (B, C).
        """
        return self.sample_with_log_prob(noise)[0]

    def sample_with_log_prob(self, noise: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Draw one action per sample, and compute the logarithm of its density.

        The density is computed from u itself, so that it is exact even where the tanh is near the bounds.

        Args:
            noise: Standard normal numbers, shape (B, C). None means that they are drawn.

        Returns:
            Actions in physical units, shape (B, C), and the logarithms of their densities, shape (B,).
        """
        if noise is None:
            noise = torch.randn_like(self.mean)
        u = self.mean + self.log_sigma.exp() * noise
        return self.space.to_physical(torch.tanh(u)), self._log_density(u, noise)

    def log_prob(self, action: Tensor) -> Tensor:
        """Return the logarithm of the density of actions, per physical unit of each component.

        Args:
            action: Actions in physical units, shape (B, C), within the bounds.

        Returns:
            Natural logarithms of the densities, shape (B,).
        """
        u = torch.atanh(self.space.to_unit(action).clamp(-INSIDE, INSIDE))
        return self._log_density(u, (u - self.mean) / self.log_sigma.exp())

    def _log_density(self, u: Tensor, noise: Tensor) -> Tensor:
        normal = -0.5 * noise.square() - self.log_sigma - 0.5 * math.log(2 * math.pi)
        log_slope = 2 * (math.log(2) - u - functional.softplus(-2 * u))  # log(1 - tanh(u)^2), without its underflow
        return (normal - log_slope - u.new_tensor(self.space.scale).log()).sum(dim=-1)
