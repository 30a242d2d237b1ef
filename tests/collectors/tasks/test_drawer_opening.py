"""Drawer opening: the drawer itself, when it is open, and an expert who catches the handle again."""

import numpy as np
import pybullet
import pytest

from collectors.simulation import World
from collectors.tasks.drawer import DAMPING, FRICTION, GAP, TRAVEL
from collectors.tasks.drawer_opening import HOOK_Z, OPEN, DrawerOpening
from tests.helpers.drawers import slide
from tests.helpers.worlds import AGAIN, begin, hold, move, perform


def pull(task, force: float, seconds: float) -> float:
    """Pull the drawer with a constant force, the arm locked; returns its speed at the end."""
    client = task.world.client
    arm = {"targetVelocities": [0.0] * 7, "forces": [1000.0] * 7}
    pybullet.setJointMotorControlArray(
        task.world.robot, range(7), pybullet.VELOCITY_CONTROL, **arm, physicsClientId=client
    )
    for _ in range(round(seconds / 0.002)):
        pybullet.applyExternalForce(task.body, 0, (force, 0, 0), (0, 0, 0), pybullet.LINK_FRAME, physicsClientId=client)
        pybullet.stepSimulation(physicsClientId=client)
    return pybullet.getJointState(task.body, 0, physicsClientId=client)[1]


def test_scenes_cover_the_ranges_and_the_handle_stays_in_reach(world):
    low, high = world.workspace[:2, 0], world.workspace[:2, 1]
    scenes = [DrawerOpening.draw(np.random.default_rng(seed), world) for seed in range(300)]
    yaw = np.array([scene.yaw for scene in scenes])
    assert np.histogram(yaw, bins=8, range=(-np.pi, np.pi))[0].min() > 15
    way = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    handle = np.array([scene.xy for scene in scenes]) + GAP * way
    for at in (handle, handle + (OPEN + 0.06) * way):
        assert (at >= low).all()
        assert (at <= high).all()
    assert np.ptp(handle, axis=0).min() > 0.2


def test_success_is_more_than_10_cm(world):
    task = begin(DrawerOpening, world, 1)
    assert not task.success()
    slide(task, OPEN - 0.001)
    assert not task.success()
    slide(task, OPEN + 0.001)
    assert task.success()


def test_the_drawer_sticks_below_its_friction_and_moves_above(world):
    task = begin(DrawerOpening, world, 1)
    pull(task, 0.9 * FRICTION, 0.5)
    assert abs(task.opening) < 1e-5
    speed = pull(task, FRICTION + 3.0, 0.4)
    assert speed == pytest.approx(3.0 / DAMPING, rel=0.03)
    assert pull(task, 30.0, 1.0) == pytest.approx(0.0, abs=1e-3)
    assert task.opening == pytest.approx(TRAVEL, abs=1e-3)


def test_a_drawer_that_is_let_go_stops_soon(world):
    task = begin(DrawerOpening, world, 1)
    slide(task, 0.05, speed=0.4)
    assert abs(pull(task, 0.0, 0.2)) < 1e-6
    assert 0.053 < task.opening < 0.06


def test_the_state_is_the_pose_of_the_moving_part(world):
    task = begin(DrawerOpening, world, 4)
    slide(task, 0.07)
    hold(world, 1)
    link = pybullet.getLinkState(task.body, 0, computeForwardKinematics=True, physicsClientId=world.client)
    state = task.state()
    np.testing.assert_allclose(state["object"], [*link[4], *link[5]], atol=1e-6)
    np.testing.assert_allclose(state["drawer"], [0.07], atol=1e-6)


def test_a_gripper_above_the_handle_opens_nothing(world):
    task = begin(DrawerOpening, world, 1)
    theta = np.arctan(np.tan(task.scene.yaw))
    move(world, (*task.at(0.02, 0.0), HOOK_Z + 0.05, theta), opening=0.0)
    move(world, (*task.at(0.14, 0.0), HOOK_Z + 0.05, theta), opening=0.0)
    assert abs(task.opening) < 1e-6


def test_the_wrench_at_home_is_nothing(world):
    begin(DrawerOpening, world, 1)
    hold(world, 2)
    assert np.abs(world.wrench[-50:] - world.tare_offset).max() < 0.05


def test_the_expert_succeeds_with_forces_of_tens_of_newtons(world):
    for seed in range(4):
        task = begin(DrawerOpening, world, seed)
        assert perform(task, seed) is not None
        force = np.linalg.norm((world.wrench - world.tare_offset)[:, :3], axis=1)
        assert FRICTION < force.max() < 80.0


def test_the_expert_catches_the_handle_again(world):
    """The drawer is shut under its gripper, half way."""
    task = begin(DrawerOpening, world, 2)
    shut = []

    def disturb(step):
        if not shut and task.opening > 0.05:
            slide(task, 0.0)
            shut.append(step)

    assert perform(task, steps=AGAIN, disturb=disturb) is not None
    assert shut


def test_the_same_seed_gives_the_same_bytes_in_a_used_world(world):
    perform(begin(DrawerOpening, world, 5), steps=25)
    task = begin(DrawerOpening, world, 6)
    used = perform(task, 6), world.wrench.tobytes()
    with World(world.config) as fresh:
        assert used == (perform(begin(DrawerOpening, fresh, 6), 6), fresh.wrench.tobytes())
