"""How the compliant gripper meets things."""

import numpy as np
import pytest

from collectors.simulation import World
from collectors.tasks.gripper import travel_steps
from tests.helpers.worlds import hold, move


@pytest.fixture
def world(robot_world: World) -> World:
    return robot_world


def tared(world: World) -> np.ndarray:
    return world.wrench.astype(np.float64) - world.tare_offset


@pytest.mark.parametrize("opening", [0.0, 1.0])
@pytest.mark.parametrize("theta", [0.0, 0.8])
def test_pressing_a_centimetre_into_a_rigid_block(world: World, opening: float, theta: float):
    top = 0.06
    world.add_box((0.06, 0.06, top / 2), (0.55, 0.0, top / 2), 0.0, 0.0, 0.5)
    world.tare()
    move(world, (0.55, 0.0, top + world.fingers.tip + 0.002, theta), opening)
    hold(world, 6, opening)
    assert np.abs(tared(world)[-1, :3]).max() < 0.05  # not yet touching
    started = len(world.wrench)
    move(world, (0.55, 0.0, top + world.fingers.tip - 0.01, theta), opening, stride=0.1)
    pressed = len(world.wrench)
    hold(world, 20, opening)
    force = tared(world)[:, 2]
    expected = world.config.admittance.stiffness * 0.01
    settled = force[-100:].mean()
    assert 20 < settled < 40
    assert abs(settled / expected - 1) < 0.2
    assert force[started:].max() < 1.25 * settled  # little overshoot
    assert np.ptp(force[pressed + 150 :]) < 0.1  # no ringing: at rest 0.3 s later
    assert np.abs(tared(world)[-100:, :2]).max() < 1.0  # no chatter against friction either


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_leaning_sideways_on_a_wall_does_not_chatter(world: World, side: float):
    world.add_box((0.05, 0.1, 0.02), (0.55 + side * 0.09, 0.0, 0.02), 0.0, 0.0, 0.5)
    world.tare()
    move(world, (0.55, 0.0, 0.02, 0.0), opening=0.0)
    move(world, (0.55 + side * 0.06, 0.0, 0.02, 0.0), opening=0.0, stride=0.2)
    hold(world, 20, opening=0.0)  # a finger that sticks may slip once more within half a second
    rest = tared(world)[-100:]
    lean = world.config.admittance.stiffness * (world.target - [*world.tcp[:3], 0.0])[0]
    np.testing.assert_allclose(rest[:, 0].mean(), -lean, rtol=0.02)
    assert abs(lean) > 20
    assert np.ptp(rest, axis=0).max() < 0.2


@pytest.mark.parametrize("mass", [0.1, 1.0])
def test_pushing_a_free_block_takes_the_friction_force(world: World, mass: float):
    friction = 0.6
    block = world.add_box((0.025, 0.025, 0.025), (0.61, 0.0, 0.025), 0.0, mass, friction)
    world.tare()
    move(world, (0.55, 0.0, 0.02, 0.0), opening=0.0)
    before = world.pose(block)
    move(world, (0.67, 0.0, 0.02, 0.0), opening=0.0, stride=0.1)
    slides = tared(world)[-100:, 0].mean()
    expected = -friction * world.config.table_friction * mass * 9.81
    np.testing.assert_allclose(slides, expected, rtol=0.1)
    assert world.pose(block)[0] > before[0] + 0.05
    assert abs(world.pose(block)[1]) < 2e-3


@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_grasp_and_lift(world: World, yaw: float):
    """A 5 cm, 0.1 kg block, gripped a little off centre, comes up and stays put in the gripper while it moves about."""
    block = world.add_box((0.025, 0.025, 0.025), (0.552, 0.004, 0.025), yaw, 0.1, 0.5)
    world.tare()
    move(world, (0.55, 0.0, 0.02, yaw))
    hold(world, 6 + travel_steps(world, 1.0), opening=0.0)
    assert world.finger_contacts(block) == (True, True)
    gripped = world.pose(block)[:3] - world.tcp[:3]
    move(world, (0.55, 0.0, 0.2, yaw), opening=0.0)
    move(world, (0.65, 0.1, 0.2, yaw), opening=0.0)
    hold(world, 10, opening=0.0)
    assert world.finger_contacts(block) == (True, True)
    np.testing.assert_allclose(world.pose(block)[:3] - world.tcp[:3], gripped, atol=3e-3)
    np.testing.assert_allclose(tared(world)[-50:].mean(axis=0)[:3], [0, 0, -0.981], atol=0.05)
    hold(world, 6 + travel_steps(world, 1.0), opening=1.0)
    assert world.finger_contacts(block) == (False, False)
    assert world.pose(block)[2] < 0.03


def test_one_finger_on_a_block_is_told_from_two(world: World):
    block = world.add_box((0.02, 0.02, 0.02), (0.55, 0.045, 0.02), 0.0, 0.1, 0.5)
    assert world.finger_contacts(block) == (False, False)
    move(world, (0.55, 0.0, 0.04 + world.fingers.tip - 0.004, 0.0), stride=0.3)
    hold(world, 4)
    assert world.finger_contacts(block) == (False, True)  # left opens along gripper y = base -y at yaw 0
    move(world, (0.55, 0.0, 0.1, 0.0))
    assert world.finger_contacts(block) == (False, False)


def test_a_blocked_gripper_never_presses_harder_than_its_leash(world: World):
    """However long one pushes, the commanded pose stays within `max_deviation` of the gripper."""
    world.tare()
    move(world, (0.55, 0.0, 0.06, 0.0))
    world.add_box((0.1, 0.1, 0.02), (0.55, 0.0, 0.02), 0.0, 0.0, 0.5)
    for _ in range(20):
        world.step([1.0, 0.0, 0.0, -0.01, 0.0])
    hold(world, 10)
    law = world.config.admittance
    assert tared(world)[-1, 2] < 1.05 * law.stiffness * law.max_deviation
