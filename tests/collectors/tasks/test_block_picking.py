"""Block picking: what is drawn, when it is done, and an expert who does not give up."""

import numpy as np

from collectors.tasks.block_picking import LIFTED, MARGIN, BlockPicking
from tests.helpers.worlds import AGAIN, begin, hold, move, perform, place


def test_scenes_cover_the_ranges(world):
    scenes = [BlockPicking.draw(np.random.default_rng(seed), world) for seed in range(300)]
    xy = np.array([scene.xy for scene in scenes])
    inside = world.workspace[:2] + np.array([MARGIN, -MARGIN])
    assert (xy >= inside[:, 0]).all()
    assert (xy <= inside[:, 1]).all()
    for name, low, high in (("half", 0.01875, 0.03125), ("mass", 0.05, 0.15), ("friction", 0.2, 0.4)):
        values = np.array([getattr(scene, name) for scene in scenes])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high


def test_the_same_seed_draws_the_same_scene(world):
    assert begin(BlockPicking, world, 3).drawn() == begin(BlockPicking, world, 3).drawn()
    assert begin(BlockPicking, world, 3).drawn() != begin(BlockPicking, world, 4).drawn()


def test_success_needs_the_height_and_the_grasp(world):
    """Lifted and held succeeds; held but low does not, and neither does high in the air without the fingers."""
    task = begin(BlockPicking, world, 1)
    x, y = task.scene.xy
    place(world, task.body, (x, y, task.scene.half + LIFTED + 0.05))
    assert not task.success()

    task = begin(BlockPicking, world, 1)
    yaw = world.yaw(task.body)
    move(world, (x, y, 0.1, yaw))
    move(world, (x, y, task.scene.half, yaw), stride=0.5)
    hold(world, 6, opening=0.0)
    assert world.holds(task.body)
    heights = []
    while not task.success():
        heights.append(world.pose(task.body)[2] - task.scene.half)
        world.step([0.0, 0.0, 0.0, 0.002, 0.0])
        assert len(heights) < 80
    assert LIFTED - 0.005 < max(heights) <= LIFTED


def test_the_expert_succeeds_and_its_demonstrations_differ(world):
    lengths = {perform(begin(BlockPicking, world, 7), seed=seed) for seed in range(6)}
    assert None not in lengths
    assert len(lengths) > 1
    assert perform(begin(BlockPicking, world, 7), noise=0.0) == perform(begin(BlockPicking, world, 7), 1, noise=0.0)


def test_the_expert_tries_again_after_a_slip(world):
    """The block is taken out of the closed gripper and put down elsewhere."""
    task = begin(BlockPicking, world, 2)
    x, y = task.scene.xy
    taken = []

    def take(step):
        if not taken and world.holds(task.body):
            place(world, task.body, (x - 0.05, y - 0.08, task.scene.half))
            taken.append(step)

    assert perform(task, steps=AGAIN, disturb=take) is not None
    assert taken
