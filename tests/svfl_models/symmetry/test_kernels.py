"""Filters against escnn's own: same weights, same filter."""

import itertools

import pytest
import torch

from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS
from svfl_models.networks.layer_factory import SymmetricLayers
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.kernels import initial_deviations, kernels_between
from svfl_models.symmetry.layers import SymmetricConv, SymmetricLinear, low_rank
from svfl_models.symmetry.planar_escnn import R2Conv
from svfl_models.symmetry.representations import direction_type, restricted

pytestmark = pytest.mark.slow

every_group = pytest.mark.parametrize(
    "group", [group for group in GROUPS.values() if len(group) > 1], ids=lambda g: g.name
)


def pairs_of_types(group):
    layers = SymmetricLayers(group)
    hidden, image = layers.hidden(3), layers.image(4)
    seen = restricted(layers.hidden(2), group)
    mixed = layers.joined([hidden, layers.vector(ACTION_PARTS), layers.image(2), hidden])
    yield from ((image, hidden, 3), (hidden, layers.hidden(2), 3), (mixed, image, 3), (hidden, hidden, 1))
    yield from ((layers.vector(WRENCH_PARTS), hidden, 1), (hidden, layers.vector(ACTION_PARTS), 1))
    yield from ((mixed, hidden, 1), (layers.vector(PROPRIO_PARTS), mixed, 1), (seen, direction_type(seen.gspace), 1))


def escnn_with_the_weights_of(ours, source, target, side):
    """escnn orders weights by pairs of representations, we by runs of equal fields."""
    theirs = R2Conv(source, target, side, initialize=False, recompute=True).to(ours.weights.dtype)
    expansion = theirs.basisexpansion
    names = [[field.name for field in kind] for kind in (target, source)]
    place = {}  # of the weights of a pair of fields, escnn's order
    for pair in expansion._representations_pairs:
        start, stop = expansion._weights_ranges[pair]
        outputs, inputs = (
            [i for i, name in enumerate(of) if name == one] for of, one in zip(names, pair[::-1], strict=True)
        )
        chunks = torch.arange(start, stop).view(len(outputs) * len(inputs), -1)
        place |= dict(zip(itertools.product(outputs, inputs), chunks, strict=True))
    runs = [[list(run) for _, run in itertools.groupby(range(len(of)), key=of.__getitem__)] for of in names]
    order = [place[pair] for b, a in itertools.product(*runs) for pair in itertools.product(b, a) if pair in place]
    with torch.no_grad():
        theirs.weights[torch.cat(order)] = ours.weights
        if theirs.bias is not None:
            theirs.bias.copy_(ours.bias)
    return theirs


@every_group
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_filters_are_those_of_escnn(group, dtype):
    for source, target, side in pairs_of_types(group):
        ours = SymmetricConv(source, target, side, padding=0).to(dtype)
        torch.nn.init.normal_(ours.bias)
        filter_, bias = ours.expand_parameters()
        expected, expected_bias = escnn_with_the_weights_of(ours, source, target, side).expand_parameters()
        torch.testing.assert_close(filter_, expected)
        torch.testing.assert_close(bias, torch.zeros_like(bias) if expected_bias is None else expected_bias)


@every_group
def test_few_rows_and_many_are_mapped_alike(group):
    """Values and gradients, in training, where they take different ways."""
    layers = SymmetricLayers(group)
    for source, target in (
        (layers.hidden(5), layers.hidden(3)),
        (layers.hidden(2), layers.joined([layers.hidden(1)] * 2)),
    ):
        layer = SymmetricLinear(source, target).double()
        torch.nn.init.normal_(layer.bias)
        few = torch.randn(2, 3, source.size, dtype=torch.float64, requires_grad=True)
        assert few.shape[:-1].numel() < target.size
        results = [layer.train()(few), layer.eval()(few)]
        torch.testing.assert_close(*results, rtol=1e-5, atol=1e-6)
        of = (few, *layer.parameters())
        for ours, expected in zip(*(torch.autograd.grad(y.pow(3).sum(), of) for y in results), strict=True):
            torch.testing.assert_close(ours, expected, rtol=1e-4, atol=1e-4)
        assert layer.train()(few[:0]).shape == (0, 3, target.size)


def test_factors_have_the_rank_that_they_need():
    left, right = torch.randn(4, 6, 2), torch.randn(4, 2, 5)
    first, last = low_rank(left @ right)
    assert (first.shape, last.shape) == ((5, 8), (4, 2, 6))
    products = torch.einsum("ikr, kro -> koi", first.unflatten(1, (4, 2)), last)
    torch.testing.assert_close(products, left @ right, atol=1e-5, rtol=1e-5)


def test_where_no_kernel_commutes_there_is_none():
    layers = SymmetricLayers(GROUPS["D4"])
    invariant, sign = layers.space.trivial_repr, layers.space.irrep(1, 0)
    found = kernels_between(layers.space, frozenset([invariant]), frozenset([invariant, sign]), 1)
    assert len(found[invariant.name, invariant.name]) == 1
    assert found[invariant.name, sign.name].values.shape == (0, 1, 1, 1, 1)
    assert [len(one) for one in initial_deviations([(found[invariant.name, sign.name], 3)])] == [0]
