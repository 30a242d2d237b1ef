"""Networks of any set of inputs and any declared action commute with their group."""

import math

import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_data.schema.action_fields import joint_action, planar_action, pose_action
from svfl_data.schema.field import Field
from svfl_data.symmetry import WRENCH_PARTS, Part
from svfl_models.networks.action_space import PLANAR, ActionSpace, parts_of
from svfl_models.networks.input_types import (
    ImageInput,
    SequenceInput,
    VectorInput,
    actions_of,
    inputs_of_plain,
    paper_inputs,
    plain_inputs,
)
from svfl_models.networks.policy import Policy
from svfl_models.symmetry.actions import act_on_invariant, act_on_parts
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error
from tests.helpers.lifetime import TRIED, named

VELOCITY = (Part("vector", (0, 1)), Part("invariant", (2,)))
MANY = (
    ImageInput("cameras/front", 4),
    ImageInput("cameras/wrist", 3, "invariant"),
    SequenceInput("streams/wrench/wrench", WRENCH_PARTS, 4),
    SequenceInput("streams/left_finger/wrench", WRENCH_PARTS, 6),
    VectorInput("observations/tcp_velocity", VELOCITY),
)
SPACES = {"planar": PLANAR, "pose": ActionSpace.of(pose_action(0.02, 0.1))}


def scene(inputs, count=6, size=8):
    made = {}
    for one in inputs:
        if isinstance(one, ImageInput):
            made[one.name] = torch.randn(count, one.channels, size, size)
        else:
            last = sum(len(part.index) for part in one.parts)
            made[one.name] = torch.randn(count, *([one.length] if isinstance(one, SequenceInput) else []), last)
    return made


def policy(group, inputs=MANY, space=PLANAR):
    return Policy(group=group.name, preset="tiny", image_size=8, inputs=plain_inputs(inputs), action=space.plain())


@pytest.mark.parametrize("group", TRIED, ids=named)
@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seeing", [True, False])
def test_two_wrenches_two_cameras_and_any_action_are_symmetric(group, space, seeing):
    """Without pixels that move, 45 and 30 degrees are exact, too."""
    inputs = [one for one in MANY if seeing or getattr(one, "moves", "") != "pixels"]
    network, batch, own = policy(group, inputs, SPACES[space]), scene(inputs), actions_of(inputs)
    elements = group.pixel_exact if seeing else group.elements
    on_action = act_on_parts(SPACES[space].parts)
    for function, act_on_output in (
        (lambda net, x: net(x).mean, on_action),
        (lambda net, x: net(x).log_sigma, act_on_invariant),
    ):
        assert_equivariant(network, batch, group, act_on_output, elements, function, own)
    exact = (lambda net, x: net(x).mode, on_action)
    assert_equivariant(network, batch, group, exact[1], group.pixel_exact, exact[0], own)


def test_a_second_wrench_that_is_typed_wrongly_is_caught():
    lie = tuple(Part("vector" if part.kind == "axial" else part.kind, part.index) for part in WRENCH_PARTS)
    inputs = [SequenceInput("a", WRENCH_PARTS, 4), SequenceInput("b", lie, 4)]
    truth = actions_of([inputs[0], SequenceInput("b", WRENCH_PARTS, 4)])
    network = policy(GROUPS["D4"], inputs)
    errors = equivariance_error(
        lambda x: network(x).mean, scene(inputs), GROUPS["D4"], act_on_parts(PLANAR.parts), own=truth
    )
    assert [error > 1e-3 for error in errors] == [False] * 4 + [True] * 4  # rotations do not tell axial from polar


def test_an_invariant_camera_that_is_turned_all_the_same_is_caught():
    network = policy(GROUPS["D4"], MANY)
    wrong = actions_of([ImageInput("cameras/wrist", 3), *(one for one in MANY if one.name != "cameras/wrist")])
    errors = equivariance_error(
        lambda x: network(x).mean, scene(MANY), GROUPS["D4"], act_on_parts(PLANAR.parts), own=wrong
    )
    assert max(errors) > 1e-3


def test_the_planar_action_is_the_papers():
    assert PLANAR.scale == (0.5, 0.025, 0.025, 0.025, math.pi / 16)
    assert PLANAR.centre == (0.5, 0, 0, 0, 0)
    assert PLANAR.deviation_of == (0, 1, 1, 2, 3)
    assert SPACES["pose"].deviation_of == (0, 0, 1, 2, 2, 3, 4)
    assert SPACES["pose"].opening == 6


@pytest.mark.parametrize("space", [*SPACES.values(), ActionSpace.of(joint_action([(-3, 3)] * 6, "abcdef"), False)])
def test_plain_values_give_the_same_space_and_inputs(space):
    assert ActionSpace.of_plain(space.plain()) == space
    assert inputs_of_plain(plain_inputs(MANY)) == MANY
    unit = 2 * torch.rand(5, len(space)) - 1
    torch.testing.assert_close(space.to_unit(space.to_physical(unit)), unit)


def test_joint_space_is_for_plain_networks():
    joints = joint_action([(-3.0, 3.0)] * 6, [f"joint_{number}" for number in range(6)])
    with pytest.raises(TrainingError, match=r"actions/action.*no planar parts.*plain network"):
        ActionSpace.of(joints)
    network = policy(GROUPS["none"], MANY, ActionSpace.of(joints, symmetric=False))
    assert network(scene(MANY)).mode.shape == (6, 6)
    field = Field(path="streams/joints2/position", dtype="float32", shape=("T", 7))
    assert parts_of(field, symmetric=False) == (Part("invariant", tuple(range(7))),)


@pytest.mark.parametrize(
    ("change", "facts"),
    [
        ({"low": (0, -0.02, -0.03, -0.02, -0.1)}, "vector.*equal and symmetric"),
        ({"high": (1, 0.02, 0.02, 0.02, 0.2)}, "pseudoscalar.*symmetric"),
        ({"low": (0, 0)}, "2 components"),
        ({"parts": (*PLANAR.parts[:3], Part("angle", (4,)))}, "absolute angle"),
    ],
)
def test_actions_that_no_group_can_act_on_are_refused(change, facts):
    given = {"parts": PLANAR.parts, "low": (0, -0.02, -0.02, -0.02, -0.1), "high": (1, 0.02, 0.02, 0.02, 0.1)}
    with pytest.raises(TrainingError, match=facts):
        ActionSpace(**(given | change))


@pytest.mark.parametrize(
    ("inputs", "facts"), [([], "different names"), ([ImageInput(), ImageInput()], "different names")]
)
def test_inputs_that_cannot_be_told_apart_are_refused(inputs, facts):
    with pytest.raises(TrainingError, match=facts):
        policy(GROUPS["D4"], inputs)
    with pytest.raises(TrainingError, match=r"'x'.*v, f, p"):
        paper_inputs("vx")
    with pytest.raises(TrainingError, match="cannot be read"):
        inputs_of_plain([{"kind": "sound", "name": "a"}])


def test_bounds_come_from_the_declaration():
    wide = ActionSpace.of(planar_action(max_move=0.1, max_turn=0.5))
    assert wide.scale == (0.5, 0.1, 0.1, 0.1, 0.5)
    with pytest.raises(TrainingError, match="without bounds"):
        ActionSpace.of(Field(path="actions/left", dtype="float32", shape=("N", 1)))
