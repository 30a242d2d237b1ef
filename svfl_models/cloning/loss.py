"""Loss of a policy on demonstrated actions, for demonstrations whose gripper is either open or shut.

In such demonstrations the gripper opening is exactly 0 or 1, on the bounds of an action. Under a squashed Gaussian a
bound is infinitely far from the centre: its likelihood is largest for an infinite mean and zero deviation, and a
maximum-likelihood training pursues this limit at the cost of all other components. There are two losses that avoid
this. Both are unchanged if observations and actions are rotated by quarter turns or mirrored together:

- `action_error`, the default, takes the opening as the probability of "open" and uses its cross-entropy. The mean of
  the squashed Gaussian already gives this probability, since ``(1 + tanh u) / 2`` is the logistic function of 2 u. The
  other components have a squared error in units of the bounds. Deviations are not learned.
- `surprise` is the negative log-likelihood with two changes: actions are moved inside the bounds, and deviations have a
  lower limit. Deviations are learned, and an actor that is trained further by reinforcement learning can use them.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from svfl_models.networks.squashed_gaussian import SquashedGaussian

INNER = 0.99
"""Largest size of a component, as a share of its bound, that a demonstrated action is limited to before its likelihood
is computed; 0.99 is u = 2.6."""
LOG_SIGMA_FLOOR = -3.0
"""Smallest logarithm of a deviation of u. It is a deviation of 0.05, an error of 1.2 mm or 0.6 degrees in the middle of
the bounds."""

Loss = Callable[[SquashedGaussian, Tensor], Tensor]


def action_error(policy: SquashedGaussian, action: Tensor) -> Tensor:
    """Return the cross-entropy of the gripper opening plus the squared error of the rest, in units of the bounds.

    Args:
        policy: Distribution of the policy's actions for B samples.
        action: Demonstrated actions within the bounds of the network, shape (B, C).

    Returns:
        Loss of each sample, shape (B,).
    """
    at, rest = policy.space.opening, torch.tanh(policy.mean) - policy.space.to_unit(action)
    if at is None:
        return rest.square().sum(dim=-1)
    opening = functional.binary_cross_entropy_with_logits(2 * policy.mean[:, at], action[:, at], reduction="none")
    others = [index for index in range(len(policy.space)) if index != at]
    return opening + rest[:, others].square().sum(dim=-1)


def surprise(policy: SquashedGaussian, action: Tensor) -> Tensor:
    """Return the negative log-density of actions moved slightly inside the bounds, with limited deviations.

    The deviations of the policy have a smooth lower limit (`LOG_SIGMA_FLOOR`).

    Args:
        policy: Distribution of the policy's actions for B samples.
        action: Demonstrated actions within the bounds of the network, shape (B, C).

    Returns:
        Loss of each sample, shape (B,).
    """
    above = LOG_SIGMA_FLOOR + functional.softplus(policy.log_sigma - LOG_SIGMA_FLOOR)  # smooth: keeps a gradient
    inside = policy.space.to_physical(policy.space.to_unit(action).clamp(-INNER, INNER))
    return -SquashedGaussian(policy.mean, above, policy.space).log_prob(inside)


LOSSES: dict[str, Loss] = {"action": action_error, "likelihood": surprise}
"""Loss functions by the names of `cloning.config.LOSSES`."""
