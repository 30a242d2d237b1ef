"""Measures the weight of each expert of a product: its share of the precision."""

from dataclasses import dataclass

import torch
from torch import Tensor

from svfl_models.latent.networks.encoder import Parts
from svfl_models.latent.networks.poe import PoEEncoder

Share = dict[str, float]
"""Share of the precision by modality and for ``prior``; the shares sum to 1."""


@dataclass(frozen=True)
class Experts:
    """Shares of the product's precision by expert, averaged over components and frames.

    The share of an expert is the weight of its mean in the mean of the product.

    Attributes:
        every: Shares over all frames.
        contact: Shares over the frames in contact; None if there are none.
        free: Shares over the frames free of contact; None if there are none.
    """

    every: Share
    contact: Share | None
    free: Share | None


@torch.no_grad()
def experts(encoder: PoEEncoder, parts: Parts, contact: Tensor) -> Experts:
    """Compute the share of each expert in the precision of the product.

    Args:
        encoder: The encoder, in eval mode.
        parts: Outputs of the experts for F frames, for any of the modalities, as `PoEEncoder.parts` returns them.
        contact: Whether each frame is in contact, shape (F,), bool.
    """
    precision = {name: 1 / one.variance.double() for name, one in encoder.experts(parts).items()}
    total = torch.stack(list(precision.values())).sum(dim=0)
    shares = {name: (one / total).mean(dim=1) for name, one in precision.items()}  # (F,) each

    def mean(rows: Tensor) -> Share | None:
        return {name: float(one[rows].mean()) for name, one in shares.items()} if rows.any() else None

    every = mean(torch.ones_like(contact))
    assert every is not None
    return Experts(every, mean(contact), mean(~contact))
