"""Drawer closing: when it is shut, and an expert who pushes again."""

import numpy as np

from collectors.simulation import World
from collectors.tasks.drawer_closing import PUSH_Z, SHUT, TOUCH, DrawerClosing
from collectors.tasks.drawer_opening import DrawerOpening
from tests.helpers.drawers import slide
from tests.helpers.worlds import begin, hold, move, perform


def test_it_begins_open_and_stays_so(world):
    task = begin(DrawerClosing, world, 1)
    hold(world, 4)
    assert abs(task.state()["drawer"][0] - 0.10) < 1e-6
    assert np.abs(world.wrench[-50:] - world.tare_offset).max() < 0.05


def test_the_gripper_comes_down_within_the_workspace(world):
    for seed in range(100):
        scene = DrawerClosing.draw(np.random.default_rng(seed), world)
        ahead = 0.10 + TOUCH + 0.02
        x, y = np.array(scene.xy) + ahead * np.array([np.cos(scene.yaw), np.sin(scene.yaw)])
        assert (world.workspace[:2, 0] <= (x, y)).all()
        assert (world.workspace[:2, 1] >= (x, y)).all()


def test_success_is_less_than_2_cm(world):
    task = begin(DrawerClosing, world, 1)
    assert not task.success()
    slide(task, SHUT + 0.001)
    assert not task.success()
    slide(task, SHUT - 0.001)
    assert task.success()


def test_a_gripper_above_the_handle_shuts_nothing(world):
    task = begin(DrawerClosing, world, 1)
    theta = np.arctan(np.tan(task.scene.yaw))
    move(world, (*task.at(TOUCH + 0.02, 0.0), PUSH_Z + 0.05, theta), opening=0.0)
    move(world, (*task.at(-0.02, 0.0), PUSH_Z + 0.05, theta), opening=0.0)
    assert abs(task.opening - 0.10) < 1e-6


def test_the_expert_succeeds_with_forces_of_tens_of_newtons(world):
    for seed in range(4):
        task = begin(DrawerClosing, world, seed)
        assert perform(task, seed) is not None
        force = np.linalg.norm((world.wrench - world.tare_offset)[:, :3], axis=1)
        assert 4.0 < force.max() < 80.0


def test_the_expert_pushes_again(world):
    """The drawer is pulled open under its gripper, half way: the fingers are now behind the handle."""
    task = begin(DrawerClosing, world, 2)
    opened = []

    def disturb(step):
        if not opened and task.opening < 0.06:
            slide(task, 0.10)
            opened.append(step)

    assert perform(task, disturb=disturb) is not None
    assert opened


def test_the_same_seed_gives_the_same_bytes_in_a_used_world(world):
    perform(begin(DrawerOpening, world, 5), steps=25)
    task = begin(DrawerClosing, world, 6)
    used = perform(task, 6), world.wrench.tobytes()
    with World(world.config) as fresh:
        assert used == (perform(begin(DrawerClosing, fresh, 6), 6), fresh.wrench.tobytes())
