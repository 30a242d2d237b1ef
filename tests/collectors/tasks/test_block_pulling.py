"""Block pulling: what is drawn, when it is done, and an expert who does not give up."""

import math

import numpy as np
import pybullet

from collectors.simulation import World
from collectors.tasks.block_pulling import APART, HEIGHT, MARGIN, BlockPulling
from tests.helpers.worlds import begin, perform, place


def test_scenes_cover_the_ranges(world):
    scenes = [BlockPulling.draw(np.random.default_rng(seed), world) for seed in range(300)]
    xy = np.array([scene.xy for scene in scenes])
    inside = world.workspace[:2] + np.array([MARGIN, -MARGIN])
    assert (xy >= inside[:, 0]).all()
    assert (xy <= inside[:, 1]).all()
    assert all(math.dist(*scene.xy) >= APART for scene in scenes)
    for name, low, high in (("half", 0.0375, 0.05), ("mass", 0.05, 0.15), ("friction", 0.9, 1.0)):
        values = np.array([getattr(scene, name) for scene in scenes])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high


def test_success_is_contact(world):
    """Not at the start, not a millimetre apart, but when they touch."""
    task = begin(BlockPulling, world, 1)
    assert not task.success()
    x, y, *_ = world.pose(task.other)
    place(world, task.other, (x, y, HEIGHT / 2))
    for gap, done in ((0.001, False), (-0.0003, True)):
        place(world, task.body, (x + sum(task.scene.half) + gap, y, HEIGHT / 2))
        pybullet.stepSimulation(physicsClientId=world.client)
        assert task.success() == done


def test_the_expert_succeeds_and_its_demonstrations_differ(world):
    assert None not in {perform(begin(BlockPulling, world, seed), seed) for seed in range(2)}
    task = begin(BlockPulling, world, 7)
    assert np.abs(world.wrench[-1] - world.tare_offset).max() < 0.05
    assert perform(task, 0) is not None
    first = world.wrench
    assert perform(begin(BlockPulling, world, 7), 1) is not None
    assert first.tobytes() != world.wrench.tobytes()
    with World(world.config) as fresh:
        perform(begin(BlockPulling, fresh, 7), 0)
        assert first.tobytes() == fresh.wrench.tobytes()


def test_the_expert_tries_again_when_the_block_slips_away(world):
    task = begin(BlockPulling, world, 3)
    start = world.pose(task.body)
    taken = []

    def take(step):
        if not taken and math.dist(world.pose(task.body)[:2], start[:2]) > 0.03:
            place(world, task.body, start[:3])
            taken.append(step)

    assert perform(task, disturb=take) is not None
    assert taken
