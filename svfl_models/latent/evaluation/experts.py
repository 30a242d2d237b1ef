"""The weight of each expert of a product: the share of the precision that each claims."""

from dataclasses import dataclass

import torch
from torch import Tensor

from svfl_models.latent.networks.encoder import Parts
from svfl_models.latent.networks.poe import PoEEncoder

Share = dict[str, float]
"""By modality, and ``prior``; sums to 1."""


@dataclass(frozen=True)
class Experts:
    """Share of the product's precision, mean over components and frames: the weight of an expert's mean.

    Attributes:
        every: Of all frames.
        contact: Of frames in contact; None if there are none.
        free: Of frames free of contact.
    """

    every: Share
    contact: Share | None
    free: Share | None


@torch.no_grad()
def experts(encoder: PoEEncoder, parts: Parts, contact: Tensor) -> Experts:
    """Weigh the experts.

    Args:
        encoder: In eval mode.
        parts: Of F frames, of some modalities.
        contact: Whether a frame is in contact, shape (F,), bool.
    """
    precision = {name: 1 / one.variance.double() for name, one in encoder.experts(parts).items()}
    total = torch.stack(list(precision.values())).sum(dim=0)
    shares = {name: (one / total).mean(dim=1) for name, one in precision.items()}  # (F,) each

    def mean(rows: Tensor) -> Share | None:
        return {name: float(one[rows].mean()) for name, one in shares.items()} if rows.any() else None

    every = mean(torch.ones_like(contact))
    assert every is not None
    return Experts(every, mean(contact), mean(~contact))
