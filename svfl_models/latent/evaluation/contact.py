"""Measures how well a model detects contact, in a frame or between a frame and the next."""

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from svfl_models.latent.evaluation.scores import auroc, f1


@dataclass(frozen=True)
class Detection:
    """Scores of a yes-no prediction.

    Attributes:
        auroc: Area under the receiver operating characteristic; None if the truth is the same for all frames.
        f1: F1 of the predictions at a probability of one half; None if no frame is positive, neither predicted nor
            true.
        base_rate: Share of the frames that are positive in truth, 0..1.
        always_f1: F1 of always predicting yes, which a model has to exceed.
    """

    auroc: float | None
    f1: float | None
    base_rate: float
    always_f1: float | None


def detection(probability: Tensor, truth: Tensor) -> Detection:
    """Score predictions against the truth.

    Args:
        probability: Predicted probability of yes, shape (F,).
        truth: True answers, shape (F,), bool.
    """
    said, right = probability.numpy(), truth.numpy()
    return Detection(
        auroc=auroc(said, right),
        f1=f1(said > 0.5, right),
        base_rate=float(right.mean()),
        always_f1=f1(np.ones_like(right), right),
    )
