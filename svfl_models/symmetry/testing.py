"""Tests on physical inputs whether a network commutes with every element of a group.

    from svfl_models.symmetry.testing import assert_equivariant

    assert_equivariant(network, batch, GROUPS["D4"])  # for a network that scores the four directions

The actions on inputs and outputs come from `svfl_models.symmetry.actions`, never from escnn.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from svfl_models.symmetry.actions import Action, Batch, act_on_batch, act_on_scores
from svfl_models.symmetry.groups import GROUPS, Group

Function = Callable[[Batch], Tensor]

TOLERANCE = {torch.float32: 1e-5, torch.float64: 3e-6}
"""Largest relative error that counts as rounding, by dtype of the network. escnn samples its kernels in float32, which
limits the accuracy in float64, too."""


@torch.no_grad()
def equivariance_error(
    function: Function,
    batch: Batch,
    group: Group = GROUPS["D4"],
    act_on_output: Action = act_on_scores,
    elements: Sequence[np.ndarray] | None = None,
    own: Mapping[str, Action] | None = None,
) -> list[float]:
    """Return the relative error of f(g x) = g f(x) for each group element g.

    Args:
        function: The network, or any other function f of a batch x.
        batch: Physical inputs, see `actions.act_on_batch`. The more they vary, the more sensitive the test is.
        group: Group whose elements are tried.
        act_on_output: How the output should transform: `actions.act_on_scores`, ``act_on_hidden(group)``,
            ``act_on_parts(OFFSET_PARTS)``, `act_on_invariant`, or a function of your own.
        elements: Matrices of the elements to try, each of shape (2, 2). None means all elements of the group.
        own: Actions on inputs that are not the paper's, by name, see `actions.act_on_batch`.

    Returns:
        ``|f(g x) - g f(x)| / |f(x)|`` for each element: 0 if a function is exactly equivariant, of order 1 if it is not
        equivariant at all. Elements that do not map pixels onto pixels interpolate images, which adds an error.

    Raises:
        ValueError: If the output is zero everywhere, as of a network in which no ReLU is active.

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
            "the output is zero everywhere, which every action leaves unchanged: this check would be without effect"
        )
    return [
        float((function(act_on_batch(g, batch, own)) - act_on_output(g, output)).norm()) / size
        for g in (group.elements if elements is None else elements)
    ]


def assert_equivariant(
    module: nn.Module,
    batch: Batch,
    group: Group = GROUPS["D4"],
    act_on_output: Action = act_on_scores,
    elements: Sequence[np.ndarray] | None = None,
    function: Callable[[nn.Module, Batch], Tensor] | None = None,
    own: Mapping[str, Action] | None = None,
) -> None:
    """Check that a network is equivariant in train and eval mode, in float32 and float64.

    Args:
        module: The network, which is copied and not changed.
        batch: Physical inputs, see `actions.act_on_batch`.
        group: Group that the network should commute with.
        act_on_output: How the output should transform, see `equivariance_error`.
        elements: Matrices of the elements to try, each of shape (2, 2). None means all elements of the group or, if
            the batch has images or directions or the output is scores of directions, the elements that map pixels onto
            pixels.
        function: Function of the module and a batch that computes the output to check, such as hidden features. None
            means ``module(batch)``.
        own: Actions on inputs that are not the paper's, by name, see `actions.act_on_batch`. If there are any, name the
            elements, too: only quarter turns and flips are exact for images.

    Raises:
        AssertionError: If an error is larger than rounding. The message names the worst element, the mode and the
            dtype.
        ValueError: If the output is zero everywhere.

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
            errors = equivariance_error(compute, cast, group, act_on_output, elements, own)
            worst = int(np.argmax(errors))
            if not errors[worst] < tolerance:
                raise AssertionError(
                    f"not equivariant: relative error {errors[worst]:.2g} (tolerance {tolerance:.0e}) for "
                    f"R = {np.round(elements[worst], 3).tolist()}, {dtype}, {'train' if training else 'eval'} mode"
                )
