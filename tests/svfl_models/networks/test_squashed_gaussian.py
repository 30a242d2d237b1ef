import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.distributions import AffineTransform, Independent, Normal, TanhTransform, TransformedDistribution

from svfl_data.schema.action_fields import MAX_MOVE_M, MAX_TURN_RAD
from svfl_data.symmetry import ACTION_PARTS
from svfl_models.networks.action_space import PLANAR
from svfl_models.networks.squashed_gaussian import SquashedGaussian
from svfl_models.symmetry.actions import act_on_parts
from svfl_models.symmetry.groups import GROUPS

move = act_on_parts(ACTION_PARTS)


def distribution(count=6, dtype=torch.float32, sigma=-0.5):
    """With one deviation for dx and dy."""
    deviations = torch.full((count, 4), sigma, dtype=dtype) + 0.3 * torch.randn(count, 4, dtype=dtype)
    return SquashedGaussian(torch.randn(count, 5, dtype=dtype), deviations[:, [0, 1, 1, 2, 3]])


def turned(matrix, of):
    return SquashedGaussian(move(matrix, of.mean), of.log_sigma)


def reference(of):
    """The same distribution as PyTorch composes it."""
    steps = [TanhTransform(), AffineTransform(of.mean.new_tensor(PLANAR.centre), of.mean.new_tensor(PLANAR.scale))]
    return Independent(TransformedDistribution(Normal(of.mean, of.log_sigma.exp()), steps), 1)


def test_the_bounds_are_those_that_episodes_are_checked_against():
    low, high = PLANAR.to_physical(torch.tensor([[-1.0] * 5, [1.0] * 5]))
    bounds = [MAX_MOVE_M] * 3 + [MAX_TURN_RAD]
    torch.testing.assert_close(high, torch.tensor([1.0, *bounds]))
    torch.testing.assert_close(low, torch.tensor([0.0] + [-bound for bound in bounds]))
    torch.testing.assert_close(PLANAR.to_unit(torch.stack([low, high])), torch.tensor([[-1.0] * 5, [1.0] * 5]))


def test_density_is_that_of_the_composed_distribution():
    of = distribution(dtype=torch.float64)
    action = of.sample()
    torch.testing.assert_close(of.log_prob(action), reference(of).log_prob(action))


def test_the_density_integrates_to_one():
    """Component by component, as the components are independent: the others' share of the density is divided out."""
    of = distribution(1, torch.float64)
    steps = (torch.arange(4000, dtype=torch.float64) + 0.5) / 2000 - 1
    total = torch.ones(())
    for component in range(5):
        unit = torch.zeros(4000, 5, dtype=torch.float64)
        unit[:, component] = steps
        density = SquashedGaussian(of.mean.expand(4000, 5), of.log_sigma.expand(4000, 5)).log_prob(
            PLANAR.to_physical(unit)
        )
        total = total * (density.exp().sum() * PLANAR.scale[component] / 2000)
    at_centre = of.log_prob(PLANAR.to_physical(torch.zeros(1, 5, dtype=torch.float64))).exp()[0]
    assert float(total / at_centre**4) == pytest.approx(1, rel=1e-3)


@settings(max_examples=50, deadline=None)
@given(st.floats(-30, 30), st.floats(-20, 2))
def test_the_density_of_a_draw_is_exact_however_far_out_or_narrow(mean, log_sigma):
    of = SquashedGaussian(torch.full((1, 5), mean), torch.full((1, 5), log_sigma))
    action, log_prob = of.sample_with_log_prob(torch.full((1, 5), 0.5))
    assert torch.isfinite(action).all()
    assert torch.isfinite(log_prob).all()
    assert torch.isfinite(of.log_prob(action)).all()
    assert (PLANAR.to_unit(action).abs() <= 1 + 1e-6).all()
    exact = SquashedGaussian(of.mean.double(), of.log_sigma.double())
    _, expected = exact.sample_with_log_prob(torch.full((1, 5), 0.5, dtype=torch.float64))
    torch.testing.assert_close(log_prob.double(), expected, rtol=1e-5, atol=1e-4)


def test_far_out_the_density_falls_off_as_it_should():
    """log(1 - tanh(u)^2) is -2 |u| + log 4 there; written down naively it is minus infinity from u = 10 on."""
    far = torch.full((1, 5), 20.0)
    of = SquashedGaussian(far, torch.zeros(1, 5))
    expected = sum(-0.5 * math.log(2 * math.pi) + 40 - math.log(4) - math.log(scale) for scale in PLANAR.scale)
    assert float(of.sample_with_log_prob(torch.zeros(1, 5))[1]) == pytest.approx(expected, rel=1e-5)


def test_a_closed_gripper_has_a_density_and_a_gradient():
    of = SquashedGaussian(torch.zeros(2, 5, requires_grad=True), torch.zeros(2, 5, requires_grad=True))
    of.log_prob(torch.tensor([[0.0, 0.025, 0, 0, 0], [1, 0, -0.025, 0, 0]])).sum().backward()
    for leaf in (of.mean, of.log_sigma):
        assert leaf.grad is not None
        assert torch.isfinite(leaf.grad).all()


def test_draws_follow_mean_and_deviation_differentiably():
    mean = torch.zeros(1, 5, requires_grad=True)
    log_sigma = torch.zeros(1, 5, requires_grad=True)
    of = SquashedGaussian(mean, log_sigma)
    of.sample(torch.ones(1, 5)).sum().backward()
    assert mean.grad is not None
    assert log_sigma.grad is not None
    assert (mean.grad > 0).all()
    assert (log_sigma.grad > 0).all()
    torch.testing.assert_close(of.sample(torch.zeros(1, 5)), of.mode)
    drawn = PLANAR.to_unit(SquashedGaussian(torch.full((20000, 5), 0.3), torch.full((20000, 5), -1.0)).sample()).atanh()
    torch.testing.assert_close(drawn.mean(0), torch.full((5,), 0.3), atol=0.02, rtol=0)
    torch.testing.assert_close(drawn.std(0), torch.full((5,), math.exp(-1)), atol=0.01, rtol=0)


@pytest.mark.parametrize("name", ["C4", "D4"])
def test_the_turned_distribution_of_turned_actions(name):
    """Mode, draws with turned noise, and density, under every element of the pixel-exact groups."""
    of, noise = distribution(), torch.randn(6, 5)
    action, log_prob = of.sample_with_log_prob(noise)
    for g in GROUPS[name].elements:
        there = turned(g, of)
        torch.testing.assert_close(there.mode, move(g, of.mode))
        torch.testing.assert_close(there.sample(move(g, noise)), move(g, action))
        torch.testing.assert_close(there.log_prob(move(g, action)), of.log_prob(action), atol=1e-4, rtol=1e-5)
        torch.testing.assert_close(there.sample_with_log_prob(move(g, noise))[1], log_prob, atol=1e-4, rtol=1e-5)


def test_deviations_of_their_own_for_dx_and_dy_break_the_quarter_turns():
    of = distribution()
    of = SquashedGaussian(of.mean, of.log_sigma + torch.tensor([0, 0.5, 0, 0, 0]))
    action = of.sample()
    for g in GROUPS["D4"].elements:
        exchanges_x_and_y = abs(g[0, 1]) > 0.5
        same = torch.allclose(turned(g, of).log_prob(move(g, action)), of.log_prob(action), atol=1e-3)
        assert same != exchanges_x_and_y


def test_a_square_of_actions_has_no_symmetry_of_45_degrees():
    """The honest limit of squashing: it is the tanh that breaks it, not the network."""
    of = distribution()
    g = GROUPS["D8"].elements[1]
    assert not torch.allclose(turned(g, of).mode, move(g, of.mode), rtol=1e-2)
