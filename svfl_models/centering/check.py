"""Measures how far a trained network is from exact symmetry on recorded episodes."""

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
    """Number format in which a network is checked.

    Attributes:
        dtype: Data type of the weights and inputs.
        autocast: Whether PyTorch computes the expensive operations in bfloat16 (mixed precision).
        tolerance: Largest relative error of a whole network that still counts as rounding.
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
"""Value of `ElementCheck.expected` for an element under which the network must be equivariant up to rounding."""


@dataclass(frozen=True)
class ElementCheck:
    """Error of a network when the world is transformed by one group element, a rotation or reflection.

    Attributes:
        matrix: Matrix of the element in image-aligned axes, shape (2, 2).
        expected: `EXACT`, or the reason in words why the network may err more than rounding under this element.
        output_error: Relative error of the scores or offsets. None if the network gives scores and the element does not
            permute the four directions.
        hidden_error: Relative error of the trunk's features. None if the element does not belong to the network's
            group.
        accuracy: Share of correct directions on the transformed samples, 0..1.
    """

    matrix: np.ndarray
    expected: str
    output_error: float | None
    hidden_error: float | None
    accuracy: float

    @property
    def name(self) -> str:
        """Name of the element in words, such as ``90 deg, mirrored``: the flip comes before the rotation."""
        degrees = float(np.rad2deg(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))) % 360
        return f"{degrees:g} deg" + (", mirrored" if np.linalg.det(self.matrix) < 0 else "")

    @property
    def worst(self) -> float:
        """The larger of `output_error` and `hidden_error`; 0 if both are None."""
        return float(np.max([error or 0.0 for error in (self.output_error, self.hidden_error)]))  # NaN stays NaN


@torch.no_grad()
def check(
    module: CenteringModule,
    samples: CenteringSamples,
    config: TrainingConfig,
    group: Group | None = None,
    precision: str = "32",
) -> list[ElementCheck]:
    """Measure the equivariance of a network separately for each group element.

    Args:
        module: The trained network; it is not changed.
        samples: Samples to transform and to evaluate the network on.
        config: Configuration that the network was trained with.
        group: Group whose elements are tried. By default the group of the network, or D4 if the network has no
            symmetry.
        precision: Number format to compute in, a key of `PRECISIONS`: ``32``, ``64`` or ``bf16``.

    Returns:
        One check per element, in the order of ``group.elements``.

    Raises:
        TrainingError: If the output of the network is zero for every sample, as with damaged weights. A network whose
            output is NaN has errors that are NaN, which `expect_symmetric` refuses.
    """
    network = copy.deepcopy(module.classifier).to(PRECISIONS[precision].dtype).eval()
    own = network.group
    group = group or (GROUPS["D4"] if own == GROUPS["none"] else own)
    crops = Crops(samples, INPUTS[config.encoder], config.image_size, crop=config.crop)[list(range(len(samples)))]
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
    """Refuse a network whose error exceeds rounding for an element that is expected to be exact.

    Args:
        rows: Result of `check`.
        precision: Key of `PRECISIONS` that the check was made with.
        name: Name of the network in the error message, such as its file.

    Raises:
        TrainingError: If an error is too large; the message names the element with the largest one.
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
    """Return the true classes of the transformed samples; for elements outside D4 they follow from the offsets."""
    if _contains(GROUPS["D4"], matrix):
        return act_on_batch(matrix, {"direction": torch.from_numpy(samples.direction)})["direction"].numpy()
    return nearest_direction(samples.offset @ matrix.T)
