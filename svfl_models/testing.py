"""Does a network commute with the group? Checked on physical inputs, for every element.

The action on inputs and outputs comes from `svfl_data.symmetry`, never from escnn: a network that agrees with escnn's
own idea of a transformation can still disagree with physics (a mirrored torque, a flip about the other axis).
"""

import copy
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.symmetry import OFFSET_PARTS, WRENCH_PARTS, Part, act, act_on_direction, act_on_image, dihedral

Batch = dict[str, Tensor]
Function = Callable[[Batch], Tensor]
Action = Callable[[np.ndarray, Tensor], Tensor]

TOLERANCE = {torch.float32: 1e-5, torch.float64: 1e-6}
"""Relative error that counts as rounding. escnn samples its kernels in float32, so float64 gains one digit only."""

VECTORS: dict[str, tuple[Part, ...]] = {"wrench": WRENCH_PARTS, "offset": OFFSET_PARTS}


def act_on_batch(matrix: np.ndarray, batch: Batch) -> Batch:
    """Rotate or mirror the world that a batch shows.

    Args:
        matrix: Group element, shape (2, 2), image-aligned axes; an element of D4 if the batch has images or directions.
        batch: ``image`` (B, C, H, H), ``wrench`` (B, T, 6), ``offset`` (B, 2), ``direction`` (B,), or some of them.

    Returns:
        The transformed batch.

    Raises:
        ValueError: If images are to be turned by other than quarter turns and flips.
        KeyError: If it is not known how an entry transforms.
    """
    moved = {}
    for name, values in batch.items():
        array = values.detach().numpy()
        if name == "image":
            moved[name] = torch.from_numpy(act_on_image(matrix, array).copy())
        elif name == "direction":
            moved[name] = torch.from_numpy(act_on_direction(matrix, array))
        else:
            moved[name] = torch.from_numpy(act(matrix, array, VECTORS[name]))
    return moved


def act_on_scores(matrix: np.ndarray, scores: Tensor) -> Tensor:
    """Permute the scores of the four directions, shape (..., 4), by an element of D4."""
    moved = torch.empty_like(scores)
    moved[..., torch.from_numpy(act_on_direction(matrix, np.arange(4)))] = scores
    return moved


def act_on_hidden(order: int = 4) -> Action:
    """How hidden features transform: the group channels of each field are permuted as h -> g h.

    Args:
        order: N of the dihedral group D_N.

    Returns:
        Action on tensors (..., fields * 2 N), channels ordered (field, group element) and elements ordered as
        `svfl_data.symmetry.dihedral` lists them.
    """
    elements = np.stack(dihedral(order))  # (2 N, 2, 2)

    def action(matrix: np.ndarray, features: Tensor) -> Tensor:
        products = matrix @ elements
        distance = np.abs(products[:, None] - elements[None]).sum(axis=(2, 3))  # (h, candidate for g h)
        fields = features.unflatten(-1, (-1, len(elements)))  # (..., F * G) -> (..., F, G)
        moved = torch.empty_like(fields)
        moved[..., torch.from_numpy(distance.argmin(axis=1))] = fields
        return moved.flatten(-2)

    return action


def act_on_feature_map(matrix: np.ndarray, features: Tensor) -> Tensor:
    """How hidden feature maps of D4 transform, shape (B, C, H, H): pixels move and group channels are permuted."""
    moved = torch.from_numpy(act_on_image(matrix, features.detach().numpy()).copy())
    return act_on_hidden()(matrix, moved.movedim(1, -1)).movedim(-1, 1)


@torch.no_grad()
def equivariance_error(
    function: Function, batch: Batch, act_on_output: Action, elements: Sequence[np.ndarray] | None = None
) -> list[float]:
    """Relative error of f(g x) = g f(x) for each group element.

    Args:
        function: The network or any function of a batch.
        batch: Physical inputs; the more varied, the sharper the check.
        act_on_output: How the output should transform: `act_on_scores`, ``act_on_hidden()`` or your own.
        elements: Group elements as matrices; all eight of D4 by default.

    Returns:
        ``|f(g x) - g f(x)| / |f(x)|`` per element; 0 if a function is exactly equivariant, of order 1 if not at all.

    Raises:
        ValueError: If the output is zero, such as that of a network whose ReLUs are all shut.
    """
    output = function(batch)
    size = float(output.norm())
    if size == 0:
        raise ValueError(
            "the output is zero everywhere, which every action leaves alone: this check would prove nothing"
        )
    return [
        float((function(act_on_batch(g, batch)) - act_on_output(g, output)).norm()) / size
        for g in (dihedral(4) if elements is None else elements)
    ]


def assert_equivariant(
    module: nn.Module,
    batch: Batch,
    act_on_output: Action = act_on_scores,
    elements: Sequence[np.ndarray] | None = None,
    function: Callable[[nn.Module, Batch], Tensor] | None = None,
) -> None:
    """Check a network for every group element, in train and eval mode, in float32 and float64.

    Args:
        module: The network; it is copied, not changed.
        batch: Physical inputs.
        act_on_output: How the output should transform.
        elements: Group elements as matrices; all eight of D4 by default.
        function: What to compute with the module, if not ``module(batch)``, such as its hidden features.

    Raises:
        AssertionError: Naming the worst element, mode and dtype.
    """
    elements = dihedral(4) if elements is None else elements
    for dtype, tolerance in TOLERANCE.items():
        for training in (True, False):
            network = copy.deepcopy(module).to(dtype).train(training)
            cast = {name: values.to(dtype) if values.is_floating_point() else values for name, values in batch.items()}
            compute = network if function is None else partial(function, network)
            errors = equivariance_error(compute, cast, act_on_output, elements)
            worst = int(np.argmax(errors))
            if not errors[worst] < tolerance:
                raise AssertionError(
                    f"not equivariant: relative error {errors[worst]:.2g} (tolerance {tolerance:.0e}) for "
                    f"R = {np.round(elements[worst], 3).tolist()}, {dtype}, {'train' if training else 'eval'} mode"
                )
