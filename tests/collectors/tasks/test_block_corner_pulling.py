"""Block corner pulling: what is drawn, when it is done, and an expert who does not give up."""

import math

import numpy as np
import pytest

from collectors.simulation import World
from collectors.tasks.block_corner_pulling import MARGIN, OUT, BlockCornerPulling
from tests.helpers.worlds import begin, perform, place


def test_scenes_cover_the_ranges(world):
    scenes = [BlockCornerPulling.draw(np.random.default_rng(seed), world) for seed in range(300)]
    xy = np.array([scene.xy for scene in scenes])
    inside = world.workspace[:2] + np.array([MARGIN, -MARGIN])
    assert (xy >= inside[:, 0]).all()
    assert (xy <= inside[:, 1]).all()
    ranges = (
        ("half", 0.01875, 0.025), ("mass", 0.1, 0.3), ("friction", 0.6, 0.9),
        ("fixture_friction", 0.3, 0.7), ("yaw", -np.pi, np.pi), ("gap", 0.0005, 0.003),
    )  # fmt: skip
    for name, low, high in ranges:
        values = np.array([getattr(scene, name) for scene in scenes])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high


@pytest.mark.parametrize("seed", range(4))
def test_success_is_measured_in_the_axes_of_the_fixture(world, seed):
    """Along either of its walls, not towards them, not in base axes, not by lifting."""
    task = begin(BlockCornerPulling, world, seed)
    yaw, start = task.scene.yaw, world.pose(task.body)[:3]
    beyond, short = OUT + 0.001, OUT - 0.001
    cases = (
        ((beyond, 0, 0), True), ((0, beyond, 0), True), ((short, short, 0), False),
        ((-beyond, -beyond, 0), False), ((beyond, beyond, 0.02), False), ((0, 0, 0), False),
    )  # fmt: skip
    for (dx, dy, dz), done in cases:
        moved = (math.cos(yaw) * dx - math.sin(yaw) * dy, math.sin(yaw) * dx + math.cos(yaw) * dy, dz)
        place(world, task.body, start + moved, yaw)
        assert task.success() == done


def test_walls_keep_the_cube_in_its_corner(world):
    """It rests where it was put: nothing pushes it out, and nothing touches it."""
    task = begin(BlockCornerPulling, world, 5)
    before = world.pose(task.body)
    for _ in range(10):
        world.step([1.0, 0.0, 0.0, 0.0, 0.0])
    assert np.linalg.norm(world.pose(task.body)[:3] - before[:3]) < 0.0005
    assert (task.state()["fixture"][:2] == task.scene.xy).all()


def test_the_expert_succeeds_and_its_demonstrations_differ(world):
    assert None not in {perform(begin(BlockCornerPulling, world, seed), seed) for seed in range(2)}
    task = begin(BlockCornerPulling, world, 7)
    assert np.abs(world.wrench[-1] - world.tare_offset).max() < 0.05
    assert perform(task, 0) is not None
    first = world.wrench
    assert perform(begin(BlockCornerPulling, world, 7), 1) is not None
    assert first.tobytes() != world.wrench.tobytes()
    with World(world.config) as fresh:
        perform(begin(BlockCornerPulling, fresh, 7), 0)
        assert first.tobytes() == fresh.wrench.tobytes()


def test_the_expert_tries_again_when_the_cube_slips_back(world):
    task = begin(BlockCornerPulling, world, 3)
    start = world.pose(task.body)
    taken = []

    def take(step):
        if not taken and math.dist(world.pose(task.body)[:2], start[:2]) > 0.02:
            place(world, task.body, start[:3], task.scene.yaw)
            taken.append(step)

    assert perform(task, disturb=take) is not None
    assert taken
