import pytest
import torch
from escnn.nn.init import _generalized_he_init_variances

from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS
from svfl_models.networks.layer_factory import SymmetricLayers, layer_factory
from svfl_models.symmetry.actions import act_on_feature_map, act_on_hidden
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.layers import SymmetricConv, SymmetricLinear
from svfl_models.symmetry.planar_escnn import R2Conv
from svfl_models.symmetry.representations import stored
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error
from tests.helpers.lifetime import TRIED, assert_equivariant_for_life, named, part_of

FACTORY = SymmetricLayers(GROUPS["D4"])
every_group = pytest.mark.parametrize("group", TRIED, ids=named)


def conv():
    return SymmetricConv(FACTORY.hidden(2), FACTORY.hidden(3), 3, padding=1)


def linear():
    return SymmetricLinear(FACTORY.hidden(2), FACTORY.hidden(3))


@every_group
@pytest.mark.parametrize("padding", [0, 1])
def test_a_convolution_is_equivariant_before_any_pooling(group, padding):
    layers = layer_factory(group)
    layer = torch.nn.Sequential(
        layers.conv(layers.image(4), layers.hidden(2), 3, 1),
        layers.conv(layers.hidden(2), layers.hidden(1), 3, padding),
    )
    image = {"image": torch.randn(2, 4, 6, 6)}
    assert_equivariant(layer, image, group, act_on_feature_map(group), function=part_of("image"))


@every_group
@pytest.mark.parametrize(
    ("name", "parts"), [("wrench", WRENCH_PARTS), ("proprio", PROPRIO_PARTS), ("action", ACTION_PARTS)]
)
def test_a_linear_map_of_physical_numbers_is_equivariant_for_life(group, name, parts):
    layers = layer_factory(group)

    def compute(network, batch):
        return network(stored(parts, batch[name]))

    assert_equivariant_for_life(
        lambda: layers.linear(layers.vector(parts), layers.hidden(3)),
        {name: torch.randn(4, 2, 6 if name == "wrench" else 5)},
        group,
        act_on_hidden(group),
        compute,
    )


def test_linear_is_the_one_by_one_convolution():
    layer, x = linear(), torch.randn(5, 7, 16)
    as_image = SymmetricConv.forward(layer, x.movedim(-1, 1)[..., None])
    torch.testing.assert_close(layer(x), as_image[..., 0].movedim(1, -1))


@every_group
def test_initial_weights_have_the_deviations_of_escnn(group, monkeypatch):
    """With ones for random numbers the weights are their deviations; escnn has them in another order."""
    layers = SymmetricLayers(group)
    hidden = layers.hidden(2)
    mixed = layers.joined([hidden, layers.vector(ACTION_PARTS), layers.image(3)])
    monkeypatch.setattr(torch, "randn", torch.ones)
    for source, target, side in (
        (layers.vector(WRENCH_PARTS), hidden, 1),
        (hidden, mixed, 1),
        (mixed, hidden, 1),
        (layers.image(4), hidden, 3),
    ):
        expected = _generalized_he_init_variances(R2Conv(source, target, side, initialize=False).basisexpansion)
        ours = SymmetricConv(source, target, side, 0).weights.detach()
        torch.testing.assert_close(ours.sort().values, expected.sort().values)


@pytest.mark.parametrize("group", [GROUPS["none"], *TRIED], ids=named)
def test_initial_weights_keep_the_variance(group):
    layers = layer_factory(group)
    layer = layers.linear(layers.hidden(32), layers.hidden(32))
    assert layer(torch.randn(1000, 32 * layers.copies)).var().item() == pytest.approx(1, rel=0.2)


def test_a_plain_convolution_is_not_equivariant():
    plain = layer_factory(GROUPS["none"]).conv(16, 24, 3, 1)
    errors = equivariance_error(
        lambda batch: plain(batch["image"]), {"image": torch.randn(2, 16, 8, 8)}, act_on_output=act_on_feature_map()
    )
    assert errors[0] == 0
    assert min(errors[1:]) > 0.1
