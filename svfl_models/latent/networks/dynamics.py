"""Latent dynamics: states in two parts, with a prior from the state before and a posterior that also sees the frame.

Source: Lee, Nagabandi, Abbeel, Levine, "Stochastic Latent Actor-Critic", NeurIPS 2020, section 5.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from svfl_models.latent.config import Sizes
from svfl_models.latent.networks.gaussian import Gaussian
from svfl_models.latent.networks.portion import Portion
from svfl_models.latent.networks.trunks import perceptron

ACTION = 5


@dataclass(frozen=True, eq=False)
class States:
    """Latent states of B sequences of T frames.

    Attributes:
        z1: First part of the states, shape (B, T, Z1).
        z2: Second part of the states, shape (B, T, Z2).
        posterior: Distribution of z1 given the frames up to and including its own and the actions before it.
        prior: Distribution of z1 given the posterior state of the step before and the action; N(0, I) for the first
            frame.
    """

    z1: Tensor
    z2: Tensor
    posterior: Gaussian
    prior: Gaussian

    @property
    def state(self) -> Tensor:
        """Both parts of the states joined, shape (B, T, Z1 + Z2)."""
        return torch.cat([self.z1, self.z2], dim=-1)


class LatentDynamics(nn.Module):
    """Distributions of the first latent state and of each following one.

    The distributions are p(z1_0) = N(0, I), p(z2_0 | z1_0), p(z1_t | z2_t-1, a_t-1) and p(z2_t | z1_t, z2_t-1, a_t-1).
    The posterior of z1 also depends on the feature of its frame; the posterior of z2 is its prior. The prior of a step
    starts from the posterior state of the step before, as the variational bound requires. States are random draws in
    training and means in evaluation.

    Args:
        sizes: Layer sizes of the networks.
    """

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        self.sizes = sizes
        hidden, before = (sizes.hidden, sizes.hidden), sizes.z2 + ACTION
        self.first_z1 = perceptron(sizes.feature, hidden, 2 * sizes.z1)
        self.first_z2 = perceptron(sizes.z1, hidden, 2 * sizes.z2)
        self.prior_z1 = perceptron(before, hidden, 2 * sizes.z1)
        self.posterior_z1 = perceptron(sizes.feature + before, hidden, 2 * sizes.z1)
        self.next_z2 = perceptron(sizes.z1 + before, hidden, 2 * sizes.z2)

    def forward(self, feature: Tensor, action: Tensor, portion: Portion | None = None) -> States:
        """Compute the latent states of sequences.

        Args:
            feature: Feature of each frame, shape (B, T, F).
            action: Actions between the frames, each component -1..1, shape (B, T - 1, 5).
            portion: Part of a batch that the sequences are; None for a whole batch.
        """
        posterior = Gaussian.of(self.first_z1(feature[:, 0]))
        posteriors, priors = [posterior], [Gaussian.standard_like(posterior.mean)]
        z1s = [self._value(posterior, portion)]
        z2s = [self._value(Gaussian.of(self.first_z2(z1s[0])), portion)]
        for step in range(1, feature.shape[1]):
            before = torch.cat([z2s[-1], action[:, step - 1]], dim=-1)
            priors.append(Gaussian.of(self.prior_z1(before)))
            posteriors.append(Gaussian.of(self.posterior_z1(torch.cat([feature[:, step], before], dim=-1))))
            z1s.append(self._value(posteriors[-1], portion))
            z2s.append(self._value(Gaussian.of(self.next_z2(torch.cat([z1s[-1], before], dim=-1))), portion))
        return States(torch.stack(z1s, 1), torch.stack(z2s, 1), _stacked(posteriors), _stacked(priors))

    def imagine(self, z2: Tensor, action: Tensor) -> Tensor:
        """Predict states from the prior and the actions alone, without frames.

        Args:
            z2: Second part of the state to start from, shape (B, Z2).
            action: Actions, each component -1..1, shape (B, S, 5).

        Returns:
            The states after each action, shape (B, S, Z1 + Z2).
        """
        states = []
        for step in range(action.shape[1]):
            before = torch.cat([z2, action[:, step]], dim=-1)
            z1 = self._value(Gaussian.of(self.prior_z1(before)))
            z2 = self._value(Gaussian.of(self.next_z2(torch.cat([z1, before], dim=-1))))
            states.append(torch.cat([z1, z2], dim=-1))
        return torch.stack(states, 1)

    def _value(self, one: Gaussian, portion: Portion | None = None) -> Tensor:
        return one.sample(portion) if self.training else one.mean


def _stacked(steps: list[Gaussian]) -> Gaussian:
    return Gaussian(torch.stack([one.mean for one in steps], 1), torch.stack([one.variance for one in steps], 1))
