"""The movements that experts are made of."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from collectors.tasks.gripper import Gripper, nearest_turn

QUARTER = math.pi / 2


@given(st.floats(-10, 10), st.sampled_from([QUARTER, math.pi]), st.floats(-QUARTER, QUARTER))
def test_a_turn_is_equivalent_and_within_reach(theta, period, near):
    turned = nearest_turn(theta, period, near)
    assert abs(turned) <= QUARTER + 1e-9
    assert abs(math.remainder(turned - theta, period)) < 1e-9


def goals():
    return [(0.45, -0.1, 0.05, 0.6), (0.7, 0.15, 0.22, -1.2), (0.55, 0.0, 0.1, 0.0)]


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_free_gripper_arrives_with_a_soft_start_and_stop(world, noise):
    world.reset(seed=0)
    gripper = Gripper(world, np.random.default_rng(3), noise)
    for goal in goals():
        moves = []
        for action in gripper.go(*goal):
            world.step(action)
            moves.append(np.abs(action[1:] / world.action_bound).max())
        np.testing.assert_allclose(world.target, goal, atol=1e-4)
        assert moves[0] < 0.65
        assert moves[-1] < 0.65
        assert np.abs(np.diff(moves)).max() < 0.65


def test_a_blocked_gripper_gives_up(world):
    world.reset(seed=0)
    gripper = Gripper(world, np.random.default_rng(0), 0.0)
    world.add_box((0.1, 0.1, 0.05), (0.55, 0.0, 0.05), 0.0, 0.0, 0.5)
    steps = 0
    for action in gripper.go(z=0.0):
        world.step(action)
        steps += 1
    assert 10 < steps < 40
    assert world.tcp[2] > 0.1


def test_a_condition_ends_a_movement(world):
    world.reset(seed=0)
    gripper = Gripper(world, np.random.default_rng(0), 0.0)
    for action in gripper.go(z=0.05, until=lambda: world.tcp[2] < 0.15):
        world.step(action)
    assert 0.1 < world.tcp[2] < 0.15


def test_what_is_outside_the_workspace_is_not_asked_for(world):
    world.reset(seed=0)
    gripper = Gripper(world, np.random.default_rng(0), 0.0)
    for action in gripper.go(x=2.0):
        world.step(action)
    assert abs(world.target[0] - world.workspace[0, 1]) < 1e-9


def test_a_grip_does_not_trust_one_touch(world):
    """Fingers that touch at one step and part at the next have not gripped: the gripper goes on closing."""
    world.reset(seed=0)
    touches = iter([False, True, False, True, True])
    moves = list(Gripper(world, np.random.default_rng(0), 0.0).grip(0.0, travels=2.25, until=lambda: next(touches)))
    assert len(moves) == 4
    assert next(touches, None) is None
