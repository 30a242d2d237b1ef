"""The policy as a whole: turned worlds get turned actions, in image axes and in those of the base."""

import numpy as np
import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS
from svfl_models.cloning.acting import ActingPolicy
from svfl_models.cloning.config import ENCODERS, VIEWS
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.networks.action_space import PLANAR
from svfl_models.networks.policy import Policy
from svfl_models.networks.presets import PRESETS
from svfl_models.symmetry.actions import act_on_image, act_on_invariant, act_on_parts
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.ordinary import plain
from svfl_models.symmetry.testing import TOLERANCE, assert_equivariant
from svfl_models.training.trainer import parameter_count
from tests.helpers.lifetime import TRIED, assert_equivariant_for_life, named, take_a_step

pytestmark = pytest.mark.slow

D4 = GROUPS["D4"]
FRONT, MIRRORED = [[0.0, 1.0], [-1.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]]
CENTRE = torch.tensor([0.0, 0.55, 0.02, 0.0, 0.0])
act_on_action = act_on_parts(ACTION_PARTS)


def build(group=D4, encoder="vfp", preset="tiny"):
    return Policy(encoder, group.name, preset, 8)


def mean(policy, batch):
    return policy(batch).mean


def mode(policy, batch):
    return policy(batch).mode


def density(policy, batch):
    return policy(batch).log_prob(batch["action"])


@pytest.fixture
def scene(grippers):
    """Decimetres, so that nothing is small."""
    proprio = grippers["proprio"] * torch.tensor([1, 5, 5, 5, 1])
    scene = {"image": torch.randn(8, 4, 8, 8), "wrench": torch.randn(8, 64, 6)}
    return scene | {"proprio": proprio, "action": grippers["action"]}


@pytest.mark.parametrize("encoder", ENCODERS)
def test_what_a_policy_says_is_symmetric_whatever_it_looks_at(encoder, scene):
    policy = build(D4, encoder)
    assert_equivariant(policy, scene, D4, act_on_action, function=mode)
    assert_equivariant(policy, scene, D4, act_on_invariant, function=density)


@pytest.mark.parametrize("group", TRIED, ids=named)
def test_so_it_is_for_every_group(group, scene):
    assert_equivariant(build(group), scene, group, act_on_action, function=mode)


@pytest.mark.parametrize("function", [mean, mode])
def test_it_stays_so_for_life(function, scene):
    assert_equivariant_for_life(build, scene, D4, act_on_action, function, D4.elements)


def turned(matrix, axes, image, wrench, proprio):
    """The same world, turned about the workspace's centre: `matrix` acts in base axes."""
    axes = np.array(axes)
    centre = CENTRE.to(proprio)
    moved = act_on_parts(PROPRIO_PARTS)(matrix, proprio - centre) + centre
    return act_on_image(axes @ matrix @ axes.T, image), act_on_parts(WRENCH_PARTS)(matrix, wrench), moved


def errors(network, axes, dtype=torch.float32):
    """Of commanded actions, relative to how large the movements are, for each element of D4."""
    network, generator = network.to(dtype), torch.Generator().manual_seed(0)
    image = torch.rand(16, 4, 10, 10, generator=generator).to(dtype)
    wrench, proprio = (torch.randn(16, *shape, generator=generator).to(dtype) for shape in ((64, 6), (5,)))
    proprio = proprio + CENTRE.to(dtype)
    with torch.no_grad():
        action = PLANAR.to_unit(network(image, wrench, proprio))
        found = [PLANAR.to_unit(network(*turned(matrix, axes, image, wrench, proprio))) for matrix in D4.elements]
    size = float(action[:, 1:].norm())
    assert size > 0
    expected = [act_on_action(matrix, action) for matrix in D4.elements]
    return [float((a - b).norm()) / size for a, b in zip(found, expected, strict=True)]


def deployment(axes, switch=False):
    return DeploymentSpec(
        "block_picking", "front", axes, from_above(axes), CENTRE[1:3].tolist(), -0.01, 10, 1e-4, 50.0, switch
    )


def from_above(axes, scale=3.0):
    """Projection of a camera far above the middle of the workspace, whose picture has these axes and 10 pixels."""
    turn = scale * np.array(axes) * [[1], [-1]]  # rows run downwards
    middle = 4.5 - turn @ CENTRE[1:3].numpy()
    return np.array([[*turn[0], 0, middle[0]], [*turn[1], 0, middle[1]], [0, 0, 0, 1]]).tolist()


@pytest.mark.parametrize("axes", [FRONT, MIRRORED])
@pytest.mark.parametrize("switch", [False, True])
@pytest.mark.parametrize("view", VIEWS)
def test_a_turned_world_gets_the_turned_action_in_base_axes(axes, switch, view, scene):
    policy = build()
    for _ in range(2):
        for network in (policy, plain(policy)):
            for dtype, tolerance in TOLERANCE.items():
                for training in (True, False):
                    acting = ActingPolicy(network, deployment(axes, switch), view).train(training)
                    assert max(errors(acting, axes, dtype)) < tolerance
        policy.float().train()
        take_a_step(policy, mean(policy, scene))


def test_wrong_axes_are_caught():
    """A policy that believes another camera's axes is not symmetric in this one's."""
    acting = ActingPolicy(build(), deployment(MIRRORED), "camera")
    assert max(errors(acting, FRONT)) > 1e-2


def test_a_plain_policy_is_caught(scene):
    policy = build(GROUPS["none"], preset="wide")
    with pytest.raises(AssertionError, match="not equivariant"):
        assert_equivariant(policy, scene, D4, act_on_action, function=mode)
    assert min(errors(ActingPolicy(policy, deployment(FRONT), "camera"), FRONT)[1:]) > 1e-2


def test_a_switch_is_thrown_and_the_rest_is_what_the_policy_says():
    policy, inputs = build(), (torch.rand(9, 4, 10, 10), torch.randn(9, 64, 6), torch.randn(9, 5))
    with torch.no_grad():
        free, thrown = (ActingPolicy(policy, deployment(FRONT, switch), "camera")(*inputs) for switch in (False, True))
    assert torch.equal(free[:, 1:], thrown[:, 1:])
    assert torch.equal(thrown[:, 0], (free[:, 0] > 0.5).float())
    assert ((free[:, 0] > 0) & (free[:, 0] < 1)).all()


@pytest.mark.parametrize("preset", PRESETS)
def test_twins_have_comparable_parameter_counts(preset):
    counts = [parameter_count(Policy("vfp", group, preset)) for group in ("D4", "none")]
    assert counts[1] == pytest.approx(counts[0], rel=0.1)


def test_there_is_no_such_policy(scene):
    with pytest.raises(TrainingError, match=r"preset 'huge'.* tiny, default"):
        Policy(preset="huge")
    with pytest.raises(TrainingError, match="group 'D5'"):
        Policy(group="D5")
    with pytest.raises(TrainingError, match="'image'"):
        build()({"wrench": scene["wrench"], "proprio": scene["proprio"]})
