"""Does a network commute with the group? Checked on physical inputs, for every element.

    from svfl_models.symmetry.testing import assert_equivariant

    assert_equivariant(network, batch, GROUPS["D4"])  # a network that scores the four directions

The action on inputs and outputs comes from `svfl_models.symmetry.actions`, never from escnn.
"""

import copy
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from svfl_models.symmetry.actions import Action, Batch, act_on_batch, act_on_scores
from svfl_models.symmetry.groups import GROUPS, Group

Function = Callable[[Batch], Tensor]

TOLERANCE = {torch.float32: 1e-5, torch.float64: 3e-6}
"""Relative error that counts as rounding. escnn samples its kernels in float32, and float64 cannot undo that."""


@torch.no_grad()
def equivariance_error(
    function: Function,
    batch: Batch,
    group: Group = GROUPS["D4"],
    act_on_output: Action = act_on_scores,
    elements: Sequence[np.ndarray] | None = None,
) -> list[float]:
    """Relative error of f(g x) = g f(x) for each group element.

    Args:
        function: The network or any function of a batch.
        batch: Physical inputs, see `actions.act_on_batch`; the more varied, the sharper the check.
        group: Whose elements to try.
        act_on_output: How the output should transform: `actions.act_on_scores`, ``act_on_hidden(group)``,
            ``act_on_parts(OFFSET_PARTS)``, `act_on_invariant`, or your own.
        elements: Elements as matrices, if not all of the group.

    Returns:
        ``|f(g x) - g f(x)| / |f(x)|`` per element; 0 if a function is exactly equivariant, of order 1 if not at all.
        Elements that do not map pixels onto pixels interpolate images, which is an error of its own.

    Raises:
        ValueError: If the output is zero, such as that of a network whose ReLUs are all shut.

    Example:
        >>> network = CenteringClassifier("f", preset="tiny")
        >>> errors = equivariance_error(network, {"wrench": torch.randn(4, 64, 6)})
        >>> len(errors), max(errors) < 1e-4
        (8, True)
    """
    output = function(batch)
    size = float(output.norm())
    if size == 0:
        raise ValueError(
            "the output is zero everywhere, which every action leaves alone: this check would prove nothing"
        )
    return [
        float((function(act_on_batch(g, batch)) - act_on_output(g, output)).norm()) / size
        for g in (group.elements if elements is None else elements)
    ]


def assert_equivariant(
    module: nn.Module,
    batch: Batch,
    group: Group = GROUPS["D4"],
    act_on_output: Action = act_on_scores,
    elements: Sequence[np.ndarray] | None = None,
    function: Callable[[nn.Module, Batch], Tensor] | None = None,
) -> None:
    """Check a network in train and eval mode, in float32 and float64.

    Args:
        module: The network; it is copied, not changed.
        batch: Physical inputs.
        group: What it should commute with.
        act_on_output: How the output should transform.
        elements: Elements as matrices; by default all of the group, or, if images or directions are involved, those
            that map pixels onto pixels.
        function: What to compute with the module, if not ``module(batch)``, such as its hidden features.

    Raises:
        AssertionError: Naming the worst element, mode and dtype.

    Example:
        >>> network = CenteringClassifier("f", preset="tiny")
        >>> assert_equivariant(network, {"wrench": torch.randn(4, 64, 6)})
    """
    if elements is None:
        turns_only = bool(batch.keys() & {"image", "direction"}) or act_on_output is act_on_scores
        elements = group.pixel_exact if turns_only else group.elements
    for dtype, tolerance in TOLERANCE.items():
        for training in (True, False):
            network = copy.deepcopy(module).to(dtype).train(training)
            cast = {name: values.to(dtype) if values.is_floating_point() else values for name, values in batch.items()}
            compute = network if function is None else partial(function, network)
            errors = equivariance_error(compute, cast, group, act_on_output, elements)
            worst = int(np.argmax(errors))
            if not errors[worst] < tolerance:
                raise AssertionError(
                    f"not equivariant: relative error {errors[worst]:.2g} (tolerance {tolerance:.0e}) for "
                    f"R = {np.round(elements[worst], 3).tolist()}, {dtype}, {'train' if training else 'eval'} mode"
                )
