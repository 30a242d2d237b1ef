"""Diagonal Gaussians: samples, products and Kullback-Leibler divergences."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from svfl_models.latent.networks.portion import Portion

SMALLEST = 1e-4
"""Smallest variance that a network can output. It keeps the precision of an expert finite, so that the other experts of
a product always have an influence."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Independent normal distributions of Z components.

    Attributes:
        mean: Means, shape (..., Z).
        variance: Variances, positive, of the same shape.
    """

    mean: Tensor
    variance: Tensor

    @classmethod
    def of(cls, numbers: Tensor) -> "Gaussian":
        """Build Gaussians from a layer's output (..., 2 Z): the means, then the raw variances before softplus."""
        mean, raw = numbers.chunk(2, dim=-1)
        return cls(mean, functional.softplus(raw) + SMALLEST)

    @classmethod
    def standard_like(cls, numbers: Tensor) -> "Gaussian":
        """Return Gaussians of mean 0 and variance 1 with the shape, type and device of `numbers`."""
        return cls(torch.zeros_like(numbers), torch.ones_like(numbers))

    def sample(self, portion: Portion | None = None) -> Tensor:
        """Draw one value of each component, differentiable with respect to mean and variance.

        Args:
            portion: Part of a batch that the distributions belong to; None for a whole batch.
        """
        noise = torch.randn_like(self.mean) if portion is None else portion.normal(self.mean)
        return self.mean + self.variance.sqrt() * noise

    def kl(self, other: "Gaussian") -> Tensor:
        """Return the Kullback-Leibler divergence KL(self || other) of each component, shape (..., Z), [nat]."""
        ratio = self.variance / other.variance
        return 0.5 * (ratio + (self.mean - other.mean).square() / other.variance - 1 - ratio.log())


def product(experts: Sequence[Gaussian]) -> Gaussian:
    """Return the normalised product of Gaussian densities.

    The precision of the product is the sum of the experts' precisions; its mean is the mean of the experts' means,
    weighted with their precisions.

    Source: Hinton, "Training Products of Experts by Minimizing Contrastive Divergence", 2002.
    """
    precisions = torch.stack([1 / expert.variance for expert in experts])
    means = torch.stack([expert.mean for expert in experts])
    variance = 1 / precisions.sum(dim=0)
    return Gaussian(variance * (precisions * means).sum(dim=0), variance)
