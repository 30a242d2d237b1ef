"""Diagonal Gaussians: drawing from them, their products, and how far one is from another."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

SMALLEST = 1e-4
"""Least variance that a network can claim: the precision of an expert stays finite, and the others are heard."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Independent normal distributions.

    Attributes:
        mean: Shape (..., Z).
        variance: The same shape, positive.
    """

    mean: Tensor
    variance: Tensor

    @classmethod
    def of(cls, numbers: Tensor) -> "Gaussian":
        """Read a layer's output, (..., 2 Z): means, then what softplus makes variances of."""
        mean, raw = numbers.chunk(2, dim=-1)
        return cls(mean, functional.softplus(raw) + SMALLEST)

    @classmethod
    def standard_like(cls, numbers: Tensor) -> "Gaussian":
        """Mean 0 and variance 1, of a shape, type and device."""
        return cls(torch.zeros_like(numbers), torch.ones_like(numbers))

    def sample(self) -> Tensor:
        """Draw one value each, differentiable in mean and variance."""
        return self.mean + self.variance.sqrt() * torch.randn_like(self.mean)

    def kl(self, other: "Gaussian") -> Tensor:
        """Kullback-Leibler divergence KL(self || other) of each component, shape (..., Z), [nat]."""
        ratio = self.variance / other.variance
        return 0.5 * (ratio + (self.mean - other.mean).square() / other.variance - 1 - ratio.log())


def product(experts: Sequence[Gaussian]) -> Gaussian:
    """The normalised product of Gaussian densities: precisions add, means are averaged with them as weights.

    Source: Hinton, "Training Products of Experts by Minimizing Contrastive Divergence", 2002.
    """
    precisions = torch.stack([1 / expert.variance for expert in experts])
    means = torch.stack([expert.mean for expert in experts])
    variance = 1 / precisions.sum(dim=0)
    return Gaussian(variance * (precisions * means).sum(dim=0), variance)
