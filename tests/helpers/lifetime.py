"""A network commutes with its group all its life: new, after a step of the optimiser, saved and loaded, copied."""

import copy
import io
from collections.abc import Callable, Sequence

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from svfl_models.symmetry.actions import Action, Batch
from svfl_models.symmetry.groups import GROUPS, Group
from svfl_models.symmetry.testing import assert_equivariant

SYMMETRIC = [group for group in GROUPS.values() if len(group) > 1]
FEW = ("C4", "D4")
TRIED = [group if group.name in FEW else pytest.param(group, marks=pytest.mark.slow) for group in SYMMETRIC]
"""The symmetric groups as parameters of a test; the quick suite tries those that map pixels onto pixels."""


def named(group: Group) -> str:
    return group.name


def part_of(name: str) -> Callable[[nn.Module, Batch], Tensor]:
    """What a network computes that looks at one entry of the batch only."""
    return lambda network, batch: network(batch[name])


def assert_equivariant_for_life(
    build: Callable[[], nn.Module],
    batch: Batch,
    group: Group,
    act_on_output: Action,
    function: Callable[[nn.Module, Batch], Tensor] = lambda network, batch: network(batch),
    elements: Sequence[np.ndarray] | None = None,
) -> None:
    network = build()
    assert_equivariant(network, batch, group, act_on_output, elements, function)

    before = function(network, batch)
    take_a_step(network, before)
    after = function(network.eval(), batch)
    assert not torch.allclose(after, before, rtol=1e-3)
    assert_equivariant(network, batch, group, act_on_output, elements, function)

    file, loaded = io.BytesIO(), build()
    torch.save(network.state_dict(), file)
    file.seek(0)
    loaded.load_state_dict(torch.load(file, weights_only=True))
    copied = copy.deepcopy(loaded)
    torch.testing.assert_close(function(copied, batch), after, rtol=1e-5, atol=1e-4)  # densities magnify rounding
    assert_equivariant(copied, batch, group, act_on_output, elements, function)


def take_a_step(network: nn.Module, output: Tensor) -> None:
    """Towards larger outputs: shut ReLUs would prove nothing, and differences of rounding are relative."""
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    (-output.square().mean()).backward()
    optimizer.step()
