"""How well contact is told: of the frame that is seen, and of the next one, from the state and the action."""

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from svfl_models.latent.evaluation.scores import auroc, f1


@dataclass(frozen=True)
class Detection:
    """How well a yes-no question is answered.

    Attributes:
        auroc: Area under the receiver operating characteristic; None if the answer is always the same.
        f1: Of the answers at a probability of one half.
        base_rate: Share of the frames where yes is right.
        always_f1: F1 of saying yes always: what a model has to beat.
    """

    auroc: float | None
    f1: float | None
    base_rate: float
    always_f1: float | None


def detection(probability: Tensor, truth: Tensor) -> Detection:
    """Compare answers with the truth.

    Args:
        probability: Of yes, shape (F,).
        truth: Shape (F,), bool.
    """
    said, right = probability.numpy(), truth.numpy()
    return Detection(
        auroc=auroc(said, right),
        f1=f1(said > 0.5, right),
        base_rate=float(right.mean()),
        always_f1=f1(np.ones_like(right), right),
    )
