import copy

import pytest
import torch
from escnn.nn.init import _generalized_he_init_variances

from svfl_data.symmetry import WRENCH_PARTS, dihedral
from svfl_models.baselines import PlainLayers
from svfl_models.layers import SymmetricConv, SymmetricLayers, SymmetricLinear, initial_deviations
from svfl_models.representations import field_basis
from svfl_models.testing import act_on_feature_map, act_on_hidden, assert_equivariant, equivariance_error

KIT = SymmetricLayers()


def conv():
    return SymmetricConv(KIT.hidden(2), KIT.hidden(3), 3, padding=1)


@pytest.mark.parametrize("padding", [0, 1])
def test_convolution_is_equivariant_before_any_pooling(padding):
    layer = SymmetricConv(KIT.hidden(2), KIT.hidden(3), 3, padding=padding)
    assert max(map_errors(layer, torch.randn(2, 16, 8, 8))) < 1e-5


def map_errors(layer, x):
    with torch.no_grad():
        y = layer(x)
        return [
            float((layer(act_on_feature_map(g, x)) - act_on_feature_map(g, y)).norm() / y.norm()) for g in dihedral(4)
        ]


def test_linear_map_of_readings_is_equivariant(batch):
    layer = SymmetricLinear(KIT.vector(WRENCH_PARTS), KIT.hidden(3), 1, padding=0)

    def stored(network, inputs):
        return network(inputs["wrench"] @ field_basis(WRENCH_PARTS).to(inputs["wrench"]).T)

    assert_equivariant(layer, {"wrench": batch["wrench"]}, act_on_hidden(), function=stored)


def test_linear_is_the_one_by_one_convolution():
    layer = SymmetricLinear(KIT.hidden(2), KIT.hidden(3), 1, padding=0)
    x = torch.randn(5, 7, 16)
    as_image = SymmetricConv.forward(layer, x.movedim(-1, 1)[..., None])
    torch.testing.assert_close(layer(x), as_image[..., 0].movedim(1, -1))


@pytest.mark.parametrize(("source", "target"), [("vector", "hidden"), ("hidden", "hidden"), ("hidden", "directions")])
def test_initial_deviations_are_those_of_escnn(source, target):
    types = {"vector": KIT.vector(WRENCH_PARTS), "hidden": KIT.hidden(3), "directions": KIT.directions()}
    layer = SymmetricConv(types[source], types[target], 1, padding=0)
    torch.testing.assert_close(initial_deviations(layer), _generalized_he_init_variances(layer.basisexpansion))


def test_initial_deviations_of_three_by_three_kernels_are_those_of_escnn():
    layer = SymmetricConv(KIT.image(4), KIT.hidden(3), 3, padding=1)
    torch.testing.assert_close(initial_deviations(layer), _generalized_he_init_variances(layer.basisexpansion))


@pytest.mark.parametrize("kit", [KIT, PlainLayers()])
def test_initial_weights_keep_the_variance(kit):
    linear = kit.linear(kit.hidden(64), kit.hidden(64))
    assert linear(torch.randn(2000, 64 * kit.copies)).var().item() == pytest.approx(1, rel=0.15)


def test_weights_changed_in_eval_mode_take_effect_at_once():
    layer, x = conv().eval(), torch.randn(1, 16, 5, 5)
    before = layer(x)
    with torch.no_grad():
        layer.weights.mul_(2)
    torch.testing.assert_close(layer(x), 2 * before)
    layer(x).sum().backward()
    layer(x).sum().backward()  # escnn's own eval mode fails here: its cached filter has lost its graph


def test_the_state_does_not_depend_on_modes_gone_through():
    layer = conv()
    keys = list(layer.state_dict())
    assert keys == list(layer.train().state_dict()) == list(layer.eval().state_dict())
    assert not any("filter" in key or "expanded" in key for key in keys)
    fresh, x = conv().eval(), torch.randn(1, 16, 5, 5)
    assert not torch.allclose(fresh(x), layer(x))
    fresh.load_state_dict(layer.train().state_dict())
    torch.testing.assert_close(fresh(x), layer(x))


def test_layers_share_nothing():
    first, second, x = conv(), conv(), torch.randn(1, 16, 5, 5)
    copied = copy.deepcopy(second.eval())
    first.double()
    assert second(x).dtype == torch.float32
    torch.testing.assert_close(copied(x), second(x))


def test_a_plain_convolution_is_not_equivariant():
    plain = PlainLayers().conv(16, 24, 3, 1)
    assert max(map_errors(plain, torch.randn(2, 16, 8, 8))) > 0.1


def test_a_function_that_lies_about_its_symmetry_is_caught(batch):
    errors = equivariance_error(lambda b: b["wrench"][:, -1, :2].repeat(1, 4), batch, act_on_hidden())
    assert max(errors) > 0.1
