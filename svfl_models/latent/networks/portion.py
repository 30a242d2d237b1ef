"""Part of a batch that one process of a training computes."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Portion:
    """Consecutive sequences of a batch, of which other processes compute the others.

    Random numbers are drawn for the whole batch and cut to the portion, so that they do not depend on the number of
    processes. Every process must draw at the same places in the same order.

    Attributes:
        start: Number of the first sequence.
        stop: Number after the last sequence.
        whole: Number of sequences of the whole batch.
    """

    start: int
    stop: int
    whole: int

    @property
    def scale(self) -> float:
        """Factor from a sum over the portion, divided by a count of the whole batch, to a mean over the portion.

        The strategy of several processes weights each loss by the portion's share of the batch, which undoes it.
        """
        return self.whole / (self.stop - self.start)

    def normal(self, like: Tensor) -> Tensor:
        """Draw standard normal numbers with the shape, type and device of `like`.

        Args:
            like: Values of the portion's sequences, or of their frames in order, shape (n B, ...).
        """
        each = len(like) // (self.stop - self.start)
        drawn = torch.randn(self.whole * each, *like.shape[1:], dtype=like.dtype, device=like.device)
        return drawn[self.start * each : self.stop * each]
