"""Block pushing: what is drawn, when it is done, and an expert who does not give up."""

import math

import numpy as np

from collectors.simulation import World
from collectors.tasks.block_pushing import APART, LYING, MARGIN, REACHED, BlockPushing
from tests.helpers.worlds import begin, perform, place


def test_scenes_cover_the_ranges(world):
    scenes = [BlockPushing.draw(np.random.default_rng(seed), world) for seed in range(300)]
    inside = world.workspace[:2] + np.array([MARGIN, -MARGIN])
    for xy in (np.array([scene.xy for scene in scenes]), np.array([scene.goal for scene in scenes])):
        assert (xy >= inside[:, 0]).all()
        assert (xy <= inside[:, 1]).all()
    assert all(math.dist(scene.xy, scene.goal) >= APART for scene in scenes)
    for name, low, high in (("half", 0.01875, 0.025), ("mass", 0.05, 0.15), ("friction", 0.9, 1.0)):
        values = np.array([getattr(scene, name) for scene in scenes])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high


def test_success_is_near_the_goal_and_on_the_table(world):
    task = begin(BlockPushing, world, 1)
    (x, y), half = task.scene.goal, task.scene.half
    for distance, height, done in (
        (REACHED - 0.001, 0.0, True),
        (REACHED + 0.001, 0.0, False),
        (0.0, LYING + 0.001, False),
    ):
        place(world, task.body, (x + distance, y, half + height))
        assert task.success() == done


def test_the_goal_is_in_the_state_and_cannot_be_touched(world):
    task = begin(BlockPushing, world, 2)
    assert task.state()["goal"].tolist() == [*task.scene.goal, 0.0]
    place(world, task.body, (*task.scene.goal, task.scene.half))
    for _ in range(5):
        world.step([1.0, 0.0, 0.0, 0.0, 0.0])
    assert abs(world.pose(task.body)[2] - task.scene.half) < 0.0003


def test_the_expert_succeeds_and_its_demonstrations_differ(world):
    assert None not in {perform(begin(BlockPushing, world, seed), seed) for seed in range(2)}
    task = begin(BlockPushing, world, 7)
    assert np.abs(world.wrench[-1] - world.tare_offset).max() < 0.05
    assert perform(task, 0) is not None
    first = world.wrench
    assert perform(begin(BlockPushing, world, 7), 1) is not None
    assert first.tobytes() != world.wrench.tobytes()
    assert perform(begin(BlockPushing, world, 7), 0) is not None
    assert first.tobytes() == world.wrench.tobytes()
    with World(world.config) as fresh:
        perform(begin(BlockPushing, fresh, 7), 0)
        assert first.tobytes() == fresh.wrench.tobytes()


def test_the_expert_tries_again_when_the_block_slips_aside(world):
    task = begin(BlockPushing, world, 3)
    x, y = task.scene.xy
    taken = []

    def take(step):
        if not taken and math.dist(world.pose(task.body)[:2], (x, y)) > 0.02:
            way = (np.array(task.scene.goal) - (x, y)) / math.dist(task.scene.goal, (x, y))
            place(world, task.body, (x - 0.07 * way[1], y + 0.07 * way[0], task.scene.half))
            taken.append(step)

    assert perform(task, disturb=take) is not None
    assert taken
