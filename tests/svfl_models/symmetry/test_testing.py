import pytest
import torch
from torch import nn

from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, Part
from svfl_models.networks.layer_factory import layer_factory
from svfl_models.symmetry.actions import act_on_hidden, act_on_invariant, act_on_parts
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.representations import stored
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error

D4, D8 = GROUPS["D4"], GROUPS["D8"]


class Linear(nn.Module):
    """A layer that takes proprioception for what `parts` say."""

    def __init__(self, parts, group=D4):
        super().__init__()
        layers = layer_factory(group)
        self.parts = parts
        self.map = layers.linear(layers.vector(parts), layers.hidden(3))

    def forward(self, batch):
        return self.map(stored(self.parts, batch["proprio"]))


def caught(module, batch, group=D4, act_on_output=act_on_hidden(), **options):  # noqa: B008 - a constant
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(module, batch, group, act_on_output, **options)
    return True


def test_the_truth_passes(grippers):
    assert_equivariant(Linear(PROPRIO_PARTS), grippers, act_on_output=act_on_hidden())
    assert_equivariant(Linear(PROPRIO_PARTS, D8), grippers, D8, act_on_hidden(D8))


def test_a_yaw_fed_as_a_number_is_caught(grippers):
    lie = (*PROPRIO_PARTS[:3], Part("invariant", (4,)))
    assert caught(Linear(lie), grippers)
    assert caught(Linear((*PROPRIO_PARTS[:3], Part("pseudoscalar", (4,)))), grippers)


def test_a_position_that_is_not_relative_to_the_centre_is_caught(grippers):
    """As in a base frame, whose origin is the robot's foot."""
    network = Linear(PROPRIO_PARTS)
    foot = torch.tensor([0, 0.45, 0.1, 0, 0])
    assert caught(
        network, grippers, function=lambda network, b: network({"proprio": b["proprio"] + foot.to(b["proprio"])})
    )


def test_scales_of_their_own_for_x_and_y_are_caught(grippers):
    scale = torch.tensor([1, 1, 2.0, 1, 1])
    assert caught(
        Linear(PROPRIO_PARTS),
        grippers,
        function=lambda network, b: network({"proprio": b["proprio"] * scale.to(b["proprio"])}),
    )


def test_a_wrong_claim_about_the_output_is_caught(grippers):
    assert caught(Linear(PROPRIO_PARTS), grippers, act_on_output=act_on_invariant)
    assert caught(Linear(PROPRIO_PARTS, D8), grippers, D8, lambda matrix, x: act_on_hidden(D8)(matrix.T, x))


def test_a_function_of_some_elements_only_is_caught_at_the_others(grippers):
    """|x| + |y| is a thing of quarter turns and flips."""
    errors = equivariance_error(lambda b: b["proprio"][:, 1:3].abs().sum(1), grippers, D8, act_on_invariant)
    exact = [any((g == h).all() for h in D8.pixel_exact) for g in D8.elements]
    assert all((error < 1e-6) == right for error, right in zip(errors, exact, strict=True))
    assert_equivariant(
        nn.Identity(),
        grippers,
        D8,
        act_on_invariant,
        elements=D8.pixel_exact,
        function=lambda _, b: b["proprio"][:, 1:3].abs().sum(1),
    )


class HonestInTraining(nn.Module):
    def forward(self, batch):
        action = batch["action"]
        return action if self.training else action * torch.arange(1.0, 6).to(action)


def test_a_lie_in_eval_mode_only_is_caught_and_named(grippers):
    with pytest.raises(AssertionError, match=r"R = \[\[.*float32, eval mode"):
        assert_equivariant(HonestInTraining(), grippers, act_on_output=act_on_parts(ACTION_PARTS))


def test_the_network_is_not_changed(grippers):
    network = Linear(PROPRIO_PARTS).eval()
    before = {name: values.clone() for name, values in network.state_dict().items()}
    assert_equivariant(network, grippers, act_on_output=act_on_hidden())
    assert not network.training
    for name, values in network.state_dict().items():
        assert values.dtype == before[name].dtype
        assert torch.equal(values, before[name])


def test_an_output_of_zero_proves_nothing(grippers):
    with pytest.raises(ValueError, match=r"output .*zero"):
        equivariance_error(lambda b: torch.zeros(8, 8), grippers, act_on_output=act_on_hidden())


def test_directions_are_asked_for_quarter_turns_and_flips_only(batch):
    """Scores of four directions cannot turn by 45 degrees, whatever the input."""
    network = layer_factory(D8).scores(layer_factory(D8).hidden(2))
    force = layer_factory(D8).linear(layer_factory(D8).vector((Part("vector", (0, 1)),)), layer_factory(D8).hidden(2))
    assert_equivariant(
        nn.Sequential(force, nn.ReLU(), network),
        {"wrench": batch["wrench"]},
        D8,
        function=lambda net, b: net(b["wrench"][:, -1, :2]),
    )
