"""What a layer is depends on its weights alone: not on modes gone through, copies, other layers or files."""

import copy
import io
import pickle

import pytest
import torch
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from svfl_data.symmetry import WRENCH_PARTS
from svfl_models.networks.layer_factory import layer_factory
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.layers import SymmetricConv
from svfl_models.symmetry.planar_escnn import R2Conv

FACTORY = layer_factory(GROUPS["D4"])


def conv():
    return FACTORY.conv(FACTORY.hidden(2), FACTORY.hidden(3), 3, 1), torch.randn(2, 16, 5, 5)


def linear():
    return FACTORY.linear(FACTORY.hidden(2), FACTORY.hidden(3)), torch.randn(2, 16)


def mixed():
    return FACTORY.linear(FACTORY.vector(WRENCH_PARTS), FACTORY.hidden(2)), torch.randn(2, 6)


each_layer = pytest.mark.parametrize("make", [conv, linear, mixed])


def learn(layer, x):
    optimizer = torch.optim.SGD(layer.parameters(), lr=0.1)
    layer(x).square().mean().backward()
    optimizer.step()
    optimizer.zero_grad()


@each_layer
def test_both_modes_say_the_same(make):
    layer, x = make()
    torch.testing.assert_close(layer.train()(x), layer.eval()(x))
    learn(layer.train(), x)
    torch.testing.assert_close(layer.eval()(x), layer.train()(x))


@each_layer
def test_learning_in_eval_mode_takes_effect_and_twice(make):
    layer, x = make()
    layer.eval()
    outputs = [layer(x).detach()]
    for _ in range(2):
        learn(layer, x)
        outputs.append(layer(x).detach())
    assert not torch.allclose(outputs[0], outputs[1])
    assert not torch.allclose(outputs[1], outputs[2])


@each_layer
def test_keys_do_not_depend_on_modes_gone_through(make):
    layer, _ = make()
    fresh = list(layer.state_dict())
    for mode in (False, True, False, False):
        assert list(layer.train(mode).state_dict()) == fresh
    assert {name for name, _ in layer.named_parameters()} == {"weights", "bias"}


@each_layer
@pytest.mark.parametrize("modes", [(True, False), (False, True), (False, False)])
def test_a_saved_state_makes_another_layer_the_same_in_any_mode(make, modes):
    (layer, x), (other, _) = make(), make()
    layer.train(modes[0])
    other.train(modes[1])(x)
    file = io.BytesIO()
    torch.save(layer.state_dict(), file)
    file.seek(0)
    other.load_state_dict(torch.load(file, weights_only=True))
    torch.testing.assert_close(other(x), layer.train(modes[1])(x))


@each_layer
@pytest.mark.parametrize("mode", [True, False])
def test_copies_and_pickles_are_independent(make, mode):
    layer, x = make()
    layer.train(mode)(x)
    before = layer(x).detach()
    for copied in (copy.deepcopy(layer), pickle.loads(pickle.dumps(layer))):
        torch.testing.assert_close(copied(x), before, rtol=0, atol=0)
        learn(copied, x)
        assert not torch.allclose(copied(x), before)
        torch.testing.assert_close(layer(x), before, rtol=0, atol=0)


@each_layer
def test_layers_of_a_kind_share_no_memory(make):
    (first, x), (second, _) = make(), make()
    places = [{tensor.data_ptr() for tensor in one.state_dict().values()} for one in (first, second)]
    assert not places[0] & places[1]
    before = second(x)
    with torch.no_grad():
        for buffer in first.double().buffers():
            buffer.zero_()
    torch.testing.assert_close(second(x), before, rtol=0, atol=0)
    torch.testing.assert_close(make()[0](x).std(), before.std(), rtol=2, atol=1)  # nor do layers made later


@each_layer
@pytest.mark.parametrize("buffers", [False, True])
def test_an_exponential_average_follows_in_eval_mode(make, buffers):
    layer, x = make()
    averaged = AveragedModel(layer, multi_avg_fn=get_ema_multi_avg_fn(0.5), use_buffers=buffers).eval()
    averaged.update_parameters(layer)
    averaged(x)
    start = layer.weights.detach().clone()
    learn(layer, x)
    averaged.update_parameters(layer)
    torch.testing.assert_close(averaged.module.weights, (start + layer.weights) / 2)
    expected = copy.deepcopy(layer).eval()
    expected.load_state_dict(averaged.module.state_dict())
    torch.testing.assert_close(averaged(x), expected(x))
    assert not torch.allclose(averaged(x), layer(x))


def test_the_same_questions_find_escnn_out():
    """A layer of escnn's own keeps its filter in eval mode: the tests above can fail."""
    _, x = conv()
    kept = R2Conv(FACTORY.hidden(2), FACTORY.hidden(3), 3, initialize=False, recompute=True).train()
    torch.nn.init.normal_(kept.weights)
    fresh = list(kept.state_dict())
    assert list(kept.eval().state_dict()) != fresh
    before = kept.filter.clone()
    with torch.no_grad():
        kept.weights.mul_(2)
    torch.testing.assert_close(kept.filter, before)
    with pytest.raises(RuntimeError):
        copy.deepcopy(kept)
    with pytest.raises((AttributeError, pickle.PicklingError, RuntimeError)):
        pickle.dumps(kept)
    assert SymmetricConv(FACTORY.hidden(2), FACTORY.hidden(3), 3, 1)(x).shape == (2, 24, 5, 5)
