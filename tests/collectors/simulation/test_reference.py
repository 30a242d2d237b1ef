"""The reference: what bounds its motion, and where it ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from collectors.simulation import WorldConfig
from collectors.simulation.reference import Reference

pytestmark = pytest.mark.slow

TICK, DT, BOUND = 25, 0.002, np.array([0.025, 0.025, 0.025, np.pi / 16])
A = WorldConfig().max_acceleration
SMOOTHING = WorldConfig().smoothing_steps
FULL = BOUND / (TICK * DT)  # [m/s], [rad/s]
LIMIT = A * BOUND / BOUND[0]  # [m/s^2], [rad/s^2]
actions = st.lists(
    st.lists(st.sampled_from([-1.0, -0.3, 0.0, 0.5, 1.0]), min_size=4, max_size=4), min_size=1, max_size=12
)


def reference() -> Reference:
    return Reference(np.zeros(4), BOUND.tolist(), A * DT**2 / BOUND[0], SMOOTHING)


def follow(moves: list, rest: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Carry out actions in units of the bound, and rest; returns pose and command after every physics step, (N, 4)."""
    moving, commanded, poses, commands = reference(), np.zeros(4), [], []
    for move in [*np.array(moves, float) * BOUND, *np.zeros((rest, 4))]:
        for aim in np.linspace(commanded, commanded + move, TICK + 1)[1:]:
            moving.step(aim)
            poses.append(moving.pose)
            commands.append(aim)
        commanded = commanded + move
    return np.array(poses), np.array(commands)


@given(actions)
def test_acceleration_and_jerk_are_bounded(moves):
    poses, _ = follow(moves, rest=4)
    velocity = np.diff(poses, axis=0, prepend=np.zeros((1, 4))) / DT
    acceleration = np.diff(velocity, axis=0, prepend=np.zeros((1, 4))) / DT
    jerk = np.diff(acceleration, axis=0, prepend=np.zeros((1, 4))) / DT
    assert (np.abs(acceleration) <= LIMIT * (1 + 1e-6)).all()
    assert (np.abs(jerk) <= 2 * LIMIT / (SMOOTHING * DT) * (1 + 1e-4)).all()


@given(actions)
def test_it_ends_where_the_actions_add_up_to(moves):
    poses, commands = follow(moves, rest=20)
    np.testing.assert_allclose(commands[-1], np.sum(moves, axis=0) * BOUND, atol=1e-12)
    np.testing.assert_allclose(poses[-1], commands[-1], atol=1e-9)


@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize("share", [0.05, 0.3, 1.0])
def test_it_never_passes_a_command_that_does_not_turn_back(axis, share):
    poses, commands = follow([share * np.eye(4)[axis]] * 6, rest=6)
    assert (poses <= commands + 1e-12).all()
    np.testing.assert_allclose(poses[-1], commands[-1], atol=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_at_constant_speed_it_is_late_by_stopping_and_smoothing(share):
    poses, commands = follow([share * np.array([1.0, 0, 0, 0])] * 40)
    v = share * FULL[0]
    late = (commands - poses)[-1, 0]
    np.testing.assert_allclose(late, v**2 / (2 * A) + v * SMOOTHING * DT / 2, atol=v * DT)


def test_a_line_stays_a_line():
    """Commands that start no faster than the bound: the path, yaw included, is straight."""
    way = np.array([1.0, -0.4, 0.2, 0.7])
    speeds = [0.3, 0.6, 0.9, 1.0, 1.0, 0.7, 0.4, 0.1]
    poses, _ = follow([speed * way for speed in speeds], rest=4)
    along = poses[:, :1] / (way[0] * BOUND[0])
    np.testing.assert_allclose(poses, along * way * BOUND, atol=1e-5)


def test_a_turned_or_mirrored_command_is_followed_turned_or_mirrored():
    moves = np.random.default_rng(2).uniform(-1, 1, (12, 4))
    poses, _ = follow(list(moves))
    for order, signs in (((1, 0, 2, 3), (-1, 1, 1, 1)), ((0, 1, 2, 3), (1, -1, 1, -1)), ((1, 0, 2, 3), (1, 1, 1, -1))):
        moved, _ = follow(list(moves[:, order] * signs))
        np.testing.assert_array_equal(moved, poses[:, order] * signs)
