"""How far a policy is from a demonstrated action. Demonstrations command a gripper that is open or shut, so the bounds.

A gripper's opening is exactly 0 or 1. Under a squashed Gaussian that is infinitely far out: its likelihood is largest
for an infinite mean and no deviation, and a maximum-likelihood training runs after it at the cost of everything else.
So there are two ways, and both leave a world that is turned as it is:

- `action_error`, the default: the opening as the probability of "open", by cross-entropy, which asks for the same
  number, since ``(1 + tanh u) / 2`` is the logistic function of 2 u; the rest by its squared error in units of the
  bounds. Deviations are not learned.
- `surprise`, the likelihood, mended: actions are pulled inside the bounds, and deviations have a floor. Deviations are
  learned, which an actor that goes on with reinforcement learning can use.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from svfl_models.networks.squashed_gaussian import SquashedGaussian, to_physical, to_unit

INNER = 0.99
"""How far out a demonstrated action may lie, as a share of the bound, before its likelihood is asked for: u = 2.6."""
LOG_SIGMA_FLOOR = -3.0
"""Least logarithm of a deviation of u: 0.05, an error of 1.2 mm or 0.6 degrees in the middle of the bounds."""

Loss = Callable[[SquashedGaussian, Tensor], Tensor]


def action_error(policy: SquashedGaussian, action: Tensor) -> Tensor:
    """Cross-entropy of the gripper's opening, plus the squared error of the rest in units of the bounds.

    Args:
        policy: What the policy says, for B samples.
        action: What was demonstrated, shape (B, 5).

    Returns:
        Shape (B,).
    """
    opening = functional.binary_cross_entropy_with_logits(2 * policy.mean[:, 0], action[:, 0], reduction="none")
    rest = torch.tanh(policy.mean[:, 1:]) - to_unit(action)[:, 1:]
    return opening + rest.square().sum(dim=-1)


def surprise(policy: SquashedGaussian, action: Tensor) -> Tensor:
    """Negative logarithm of the density of actions slightly inside the bounds, with deviations above a floor.

    Args:
        policy: What the policy says, for B samples.
        action: What was demonstrated, shape (B, 5).

    Returns:
        Shape (B,).
    """
    above = LOG_SIGMA_FLOOR + functional.softplus(policy.log_sigma - LOG_SIGMA_FLOOR)  # smooth: it can come back up
    inside = to_physical(to_unit(action).clamp(-INNER, INNER))
    return -SquashedGaussian(policy.mean, above).log_prob(inside)


LOSSES: dict[str, Loss] = {"action": action_error, "likelihood": surprise}
"""By the names of `cloning.config.LOSSES`."""
