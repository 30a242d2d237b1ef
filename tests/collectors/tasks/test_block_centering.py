"""Block centering as a task: what counts as centred, and an expert who feels the block first."""

import numpy as np
import pytest

from collectors.tasks.block_centering import AROUND, CENTRED, BlockCentering
from collectors.tasks.gripper import Gripper
from tests.helpers.worlds import begin, hold, move, perform, place


@pytest.mark.parametrize(
    ("beside", "deep", "achieved"), [(-0.001, 0.002, True), (0.001, 0.002, False), (-0.001, -0.002, False)]
)
def test_success_from_both_sides_of_both_thresholds(world, beside, deep, achieved):
    """The block is put where the open gripper is or is not centred, around it or still above."""
    task = begin(BlockCentering, world, 3)
    place(world, task.body, (0.7, 0.15, task.scene.block_half))
    height = 2 * task.scene.block_half + task.world.fingers.tip - AROUND - deep
    move(world, (0.5, 0.0, height, 0.0))
    hold(world, 4)
    x, y, z = world.tcp[:3]
    place(world, task.body, (x + CENTRED + beside, y, task.scene.block_half))
    assert abs(z - height) < 5e-4
    assert task.success() == achieved


def test_the_expert_feels_the_block_before_it_centres(world):
    task = begin(BlockCentering, world, 5)
    forces = []
    moves = task.expert(Gripper(world, np.random.default_rng(0)))
    while not task.success():
        world.step(next(moves))
        touched = any(world.finger_contacts(task.body))
        forces.append(world.wrench[-1, 2] - world.tare_offset[2] if touched else 0.0)
    assert max(forces) > 5.0
    assert len(forces) < 50


def test_the_expert_follows_a_block_that_is_moved(world):
    task = begin(BlockCentering, world, 6)

    def shift(step):
        if step == 16:
            x, y = np.clip(world.pose(task.body)[:2] + 0.04, (0.4, -0.15), (0.7, 0.15))
            place(world, task.body, (x, y, task.scene.block_half))

    assert perform(task, disturb=shift, steps=50) is not None
