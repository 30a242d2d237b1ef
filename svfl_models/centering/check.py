"""How symmetric a trained network is, on real episodes."""

import copy
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_data.symmetry import OFFSET_PARTS, nearest_direction
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.data import Crops
from svfl_models.centering.module import CenteringModule, directions
from svfl_models.networks.inputs import INPUTS
from svfl_models.symmetry.actions import Action, Batch, act_on_batch, act_on_hidden, act_on_parts, act_on_scores
from svfl_models.symmetry.groups import GROUPS, Group
from svfl_models.symmetry.testing import TOLERANCE, equivariance_error


@dataclass(frozen=True)
class Precision:
    """How numbers are computed with.

    Attributes:
        dtype: Of weights and inputs.
        autocast: Whether PyTorch computes the expensive part in bfloat16 (mixed precision).
        tolerance: Relative error of a whole network that counts as rounding.
    """

    dtype: torch.dtype
    autocast: bool
    tolerance: float


PRECISIONS = {
    "32": Precision(torch.float32, False, TOLERANCE[torch.float32]),
    "64": Precision(torch.float64, False, TOLERANCE[torch.float64]),
    "bf16": Precision(torch.float32, True, 5e-2),  # 8 bits of mantissa: 4e-3 per operation
}
EXACT = "exact"
"""What is expected of an element that nothing spoils."""


@dataclass(frozen=True)
class ElementCheck:
    """What a network does when the world is rotated or mirrored.

    Attributes:
        matrix: The element, shape (2, 2).
        expected: `EXACT`, or why the network may err.
        output_error: Relative error of the scores or offsets; None for scores unless four directions are permuted.
        hidden_error: Relative error of the trunk's features; None if the network's group lacks the element.
        accuracy: Share of right directions on the transformed samples, 0..1.
    """

    matrix: np.ndarray
    expected: str
    output_error: float | None
    hidden_error: float | None
    accuracy: float

    @property
    def name(self) -> str:
        """In words, as `svfl_data.symmetry.element` builds it."""
        degrees = float(np.rad2deg(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))) % 360
        return f"{degrees:g} deg" + (", mirrored" if np.linalg.det(self.matrix) < 0 else "")

    @property
    def worst(self) -> float:
        """The larger of the errors, 0 if there is none."""
        return float(np.max([error or 0.0 for error in (self.output_error, self.hidden_error)]))  # NaN stays NaN


@torch.no_grad()
def check(
    module: CenteringModule,
    samples: CenteringSamples,
    config: TrainingConfig,
    group: Group | None = None,
    precision: str = "32",
) -> list[ElementCheck]:
    """Measure a network's equivariance, element by element.

    Args:
        module: The trained network; it is not changed.
        samples: Episodes to transform.
        config: What it was trained with.
        group: Whose elements to try; by default the network's, or D4 if it has none.
        precision: One of `PRECISIONS`.

    Raises:
        TrainingError: If the network gives NaN or only zeros, as damaged weights do.
    """
    network = copy.deepcopy(module.classifier).to(PRECISIONS[precision].dtype).eval()
    own = network.group
    group = group or (GROUPS["D4"] if own == GROUPS["none"] else own)
    crops = Crops(samples, INPUTS[config.encoder], config.image_size)[list(range(len(samples)))]
    batch = {name: crops[name].to(PRECISIONS[precision].dtype) for name in INPUTS[config.encoder]}
    act_on_output: Action = act_on_scores if network.target == "direction" else act_on_parts(OFFSET_PARTS)

    def computed(function: Callable[[Batch], Tensor]) -> Callable[[Batch], Tensor]:
        def in_precision(some: Batch) -> Tensor:
            with _mode(precision):
                return function(some).to(PRECISIONS[precision].dtype)

        return in_precision

    def error(function: Callable[[Batch], Tensor], matrix: np.ndarray, action: Action) -> float:
        try:
            (one,) = equivariance_error(computed(function), batch, own, action, [matrix])
        except ValueError as nothing:
            raise TrainingError(f"the network's output is zero for every sample: {nothing}") from nothing
        return one

    rows = []
    for matrix in group.elements:
        turned, truth = act_on_batch(matrix, batch), _directions_after(matrix, samples)
        permutes = _contains(GROUPS["D4"], matrix)
        rows.append(
            ElementCheck(
                matrix=matrix,
                expected=_expected(matrix, own, config),
                output_error=error(network, matrix, act_on_output) if permutes or network.target == "offset" else None,
                hidden_error=error(network.trunk, matrix, act_on_hidden(own)) if _contains(own, matrix) else None,
                accuracy=float((directions(computed(network)(turned)).numpy() == truth).mean()),
            )
        )
    return rows


def expect_symmetric(rows: list[ElementCheck], precision: str, name: object) -> None:
    """Refuse a network that errs by more than rounding where it must be exact.

    Raises:
        TrainingError: Naming the worst element.
    """
    exact = [row for row in rows if row.expected == EXACT]
    worst = max(exact, key=lambda row: np.nan_to_num(row.worst, nan=np.inf))
    tolerance = PRECISIONS[precision].tolerance
    if not worst.worst < tolerance:
        raise TrainingError(
            f"{name}: not symmetric: relative error {worst.worst:.2g} for {worst.name}, where rounding gives less than "
            f"{tolerance:g}; the weights or the kernel bases in this file are damaged"
        )


def _mode(precision: str) -> AbstractContextManager[None]:
    return torch.autocast("cpu", torch.bfloat16) if PRECISIONS[precision].autocast else nullcontext()


def _contains(group: Group, matrix: np.ndarray) -> bool:
    return any(np.allclose(matrix, own) for own in group.elements)


def _expected(matrix: np.ndarray, group: Group, config: TrainingConfig) -> str:
    if not _contains(group, matrix):
        return f"not in {group.name}" if group != GROUPS["none"] else "no symmetry"
    if "f" in config.encoder and config.torque == "polar" and np.linalg.det(matrix) < 0:
        return "polar torque"
    if "v" in config.encoder and not _contains(GROUPS["D4"], matrix):
        return "interpolated"
    return EXACT


def _directions_after(matrix: np.ndarray, samples: CenteringSamples) -> np.ndarray:
    """True classes of the transformed samples, from their offsets where classes are not permuted."""
    if _contains(GROUPS["D4"], matrix):
        return act_on_batch(matrix, {"direction": torch.from_numpy(samples.direction)})["direction"].numpy()
    return nearest_direction(samples.offset @ matrix.T)
