import pytest
import torch
from torch import nn

from svfl_data.symmetry import ACTION_PARTS, OFFSET_PARTS
from svfl_models.networks.heads import Actor, Critic, OffsetHead
from svfl_models.networks.layer_factory import layer_factory
from svfl_models.networks.presets import PRESETS, Widths
from svfl_models.networks.squashed_gaussian import SquashedGaussian
from svfl_models.networks.visual_force import VisualForceEncoder
from svfl_models.symmetry.actions import act_on_invariant, act_on_parts
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error
from svfl_models.training.trainer import parameter_count
from tests.helpers.lifetime import TRIED, assert_equivariant_for_life, named

D4 = GROUPS["D4"]
SMALL = Widths((2, 2, 2, 2, 2, 2), force=2, heads=1, proprio=(4, 4, 4), latent=8)
every_group = pytest.mark.parametrize("group", TRIED, ids=named)
act_on_action = act_on_parts(ACTION_PARTS)


class Policy(nn.Module):
    """What a policy is made of: the trunk, the actor, the critic."""

    def __init__(self, group, inputs="fp", actor=Actor, size=8):
        super().__init__()
        layers = layer_factory(group)
        self.trunk = VisualForceEncoder(layers, SMALL, inputs, size, window=4)
        self.actor, self.critic = actor(layers, SMALL.latent), Critic(layers, SMALL.latent)

    def act(self, batch):
        return self.actor(self.trunk(batch))


def mean(policy, batch):
    return policy.act(batch).mean


def deviations(policy, batch):
    return policy.act(batch).log_sigma


def mode(policy, batch):
    return policy.act(batch).mode


def density(policy, batch):
    return policy.act(batch).log_prob(batch["action"])


def values(policy, batch):
    return policy.critic(policy.trunk(batch), batch["action"])


@pytest.fixture
def scene(grippers):
    """What a gripper feels and knows, and what it might do; decimetres, so that nothing is small."""
    proprio = grippers["proprio"] * torch.tensor([1, 5, 5, 5, 1])
    return {"wrench": torch.randn(8, 4, 6), "proprio": proprio, "action": grippers["action"]}


@every_group
@pytest.mark.parametrize(
    ("function", "act_on_output"),
    [(mean, act_on_action), (deviations, act_on_invariant), (values, act_on_invariant)],
)
def test_mean_deviations_and_values_are_symmetric_for_life(group, function, act_on_output, scene):
    """Under every element: without an image 45 and 30 degrees are exact."""
    assert_equivariant_for_life(lambda: Policy(group), scene, group, act_on_output, function)


@every_group
@pytest.mark.parametrize(("function", "act_on_output"), [(mode, act_on_action), (density, act_on_invariant)])
def test_the_squashed_distribution_has_the_pixel_exact_symmetry_for_life(group, function, act_on_output, scene):
    assert_equivariant_for_life(lambda: Policy(group), scene, group, act_on_output, function, group.pixel_exact)


@every_group
@pytest.mark.parametrize(
    ("function", "act_on_output"),
    [(mean, act_on_action), (density, act_on_invariant), (values, act_on_invariant)],
)
def test_a_policy_that_also_sees_is_symmetric(group, function, act_on_output, scene):
    scene = scene | {"image": torch.randn(8, 4, 8, 8)}
    assert_equivariant(Policy(group, "vfp"), scene, group, act_on_output, function=function)


class Careless(Actor):
    """Deviations of their own for dx and dy, as in the reference implementation."""

    def forward(self, features):
        of = super().forward(features)
        own = 0.3 * of.log_sigma[:, :1] - 0.2
        return SquashedGaussian(
            of.mean, torch.cat([of.log_sigma[:, :1], of.log_sigma[:, 1:2] + own, of.log_sigma[:, 2:]], 1)
        )


def test_deviations_of_their_own_for_dx_and_dy_are_caught(scene):
    policy = Policy(D4, actor=Careless)
    assert_equivariant(policy, scene, D4, act_on_action, function=mean)  # nothing wrong with the mean
    assert_equivariant(policy, scene, D4, act_on_invariant, function=deviations)  # or with their being invariant
    errors = equivariance_error(lambda batch: density(policy, batch), scene, D4, act_on_invariant)
    exchanged = [abs(g[0, 1]) > 0.5 for g in D4.elements]
    assert [error > 1e-3 for error in errors] == exchanged
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(policy, scene, D4, act_on_invariant, function=density)


def test_a_plain_policy_is_caught(scene):
    policy = Policy(GROUPS["none"])
    for function, act_on_output in ((mean, act_on_action), (density, act_on_invariant), (values, act_on_invariant)):
        with pytest.raises(AssertionError, match="not equivariant"):
            assert_equivariant(policy, scene, D4, act_on_output, function=function)


@pytest.mark.parametrize("group", [GROUPS["none"], *TRIED], ids=named)
def test_shapes_bounds_and_shared_deviations(group, scene):
    policy = Policy(group)
    of = policy.act(scene)
    assert of.mean.shape == of.log_sigma.shape == (8, 5)
    assert torch.equal(of.log_sigma[:, 1], of.log_sigma[:, 2])
    assert len(torch.unique(of.log_sigma[0])) == 4
    wild = Actor(layer_factory(group), 8)(1e4 * torch.randn(8, 8 * layer_factory(group).copies)).log_sigma
    assert (wild.min(), wild.max()) == (-20, 2)
    assert values(policy, scene).shape == (8, 2)


@pytest.mark.parametrize("group", [GROUPS["none"], *TRIED], ids=named)
def test_values_are_two_opinions_about_every_component(group, scene):
    policy = Policy(group)
    action = scene["action"].clone().requires_grad_()
    both = values(policy, scene | {"action": action})
    assert not torch.allclose(both[:, 0], both[:, 1], rtol=1e-2)
    for value in both.sum(0):
        (gradient,) = torch.autograd.grad(value, action, retain_graph=True)
        assert (gradient.abs().sum(0) > 0).all()


@every_group
def test_an_offset_is_a_vector_for_life(group, scene):
    class Offset(nn.Module):
        def __init__(self):
            super().__init__()
            self.trunk = VisualForceEncoder(layer_factory(group), SMALL, "f", window=4)
            self.head = OffsetHead(layer_factory(group), layer_factory(group).hidden(SMALL.latent))

        def forward(self, batch):
            return self.head(self.trunk(batch))

    assert_equivariant_for_life(Offset, {"wrench": scene["wrench"]}, group, act_on_parts(OFFSET_PARTS))


def test_an_offset_has_the_scale_of_the_training_offsets():
    head, features = OffsetHead(layer_factory(D4), layer_factory(D4).hidden(4)), torch.randn(3, 32)
    before = head(features)
    head.fit(torch.tensor([[0.03, 0.04], [0.0, 0.0]]))
    torch.testing.assert_close(head(features), before * (0.05**2 / 4) ** 0.5)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("head", [Actor, Critic])
def test_twins_of_a_whole_policy_have_comparable_parameter_counts(preset, head):
    def count(name, group):
        widths = PRESETS[preset][name]
        trunk = VisualForceEncoder(layer_factory(group), widths, "vfp")
        return parameter_count(trunk) + parameter_count(head(layer_factory(group), widths.latent))

    assert count("cnn", GROUPS["none"]) == pytest.approx(count("svfl", D4), rel=0.1)


def test_the_actor_has_the_size_of_the_reference():
    """20,696 there: without the sign of dtheta and with five deviations."""
    assert parameter_count(Actor(layer_factory(D4), 64)) == pytest.approx(20_696, rel=0.001)
    assert parameter_count(Critic(layer_factory(D4), 64)) == pytest.approx(2 * 33_217, rel=0.001)
