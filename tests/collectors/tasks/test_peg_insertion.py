"""Peg insertion: a peg that is really held, a hole that really fits, and an expert who feels the rim."""

import numpy as np
import pybullet
import pytest

from collectors.simulation import World
from collectors.tasks.block_picking import BlockPicking
from collectors.tasks.peg_insertion import (
    CLEARANCE,
    DEPTH,
    LENGTH,
    MARGIN,
    MASS,
    NEAR,
    OUTER,
    RIM,
    SIDES,
    STRAIGHT,
    PegInsertion,
)
from tests.helpers.worlds import begin, hold, perform, place


def put(task, beside: float, depth: float, tilt: float = 0.0, towards: float = 0.0) -> None:
    """Put the peg's tip somewhere: beside the middle of the hole, below the rim."""
    x, y = task.scene.xy
    angle = task.scene.yaw + towards
    place(task.world, task.body, (0.0, 0.0, 1.0))
    quat = pybullet.getQuaternionFromEuler((tilt, 0.0, 0.0))
    axis = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    tip = np.array([x + beside * np.cos(angle), y + beside * np.sin(angle), RIM - depth])
    client = task.world.client
    pybullet.resetBasePositionAndOrientation(task.body, tip + LENGTH * axis, quat, physicsClientId=client)


def distance(task) -> float:
    """Between peg and block, as Bullet sees it."""
    points = pybullet.getClosestPoints(task.body, task.block, 0.1, physicsClientId=task.world.client)
    return min(point[8] for point in points)


def test_only_the_hole_is_drawn(world):
    scenes = [PegInsertion.draw(np.random.default_rng(seed), world) for seed in range(300)]
    xy = np.array([scene.xy for scene in scenes])
    inside = world.workspace[:2] + np.array([MARGIN, -MARGIN])
    assert (xy >= inside[:, 0]).all()
    assert (xy <= inside[:, 1]).all()
    assert np.ptp(xy, axis=0).min() > 0.95 * (0.4 - 2.0 * MARGIN)
    pegs = [world.pose(begin(PegInsertion, world, seed).body) for seed in range(3)]
    np.testing.assert_allclose(pegs, [pegs[0]] * 3, atol=1e-5)


def test_the_fingers_alone_hold_the_peg(world):
    task = begin(PegInsertion, world, 1)
    assert pybullet.getNumConstraints(physicsClientId=world.client) == 0
    assert world.holds(task.body)
    assert task.tip()[0][2] > 0.05  # clear of the block
    before = world.pose(task.body)
    hold(world, 10, opening=0.0)
    np.testing.assert_allclose(world.pose(task.body), before, atol=1e-4)
    hold(world, 6, opening=1.0)
    assert world.pose(task.body)[2] < before[2] - 0.05


def test_the_wrench_bears_the_peg_and_its_tare_takes_it_off(world):
    begin(PegInsertion, world, 1)
    empty = world.wrench[0, 2]
    assert world.tare_offset[2] - empty == pytest.approx(-MASS * 9.81, abs=0.05)
    hold(world, 2, opening=0.0)
    assert np.abs(world.wrench[-50:] - world.tare_offset).max() < 0.05


def test_the_clearance_is_what_it_says(world):
    task = begin(PegInsertion, world, 1)
    for depth in (0.005, DEPTH):
        put(task, 0.0, depth)
        assert distance(task) == pytest.approx(CLEARANCE, abs=2e-5)
        for side in range(SIDES):
            put(task, CLEARANCE, depth, towards=2.0 * np.pi * side / SIDES)
            assert distance(task) == pytest.approx(0.0, abs=2e-5)


def test_success_needs_depth_place_and_attitude(world):
    task = begin(PegInsertion, world, 1)
    assert not task.success()
    for beside, depth, tilt, done in (
        (0.0, DEPTH + 0.001, 0.0, True),
        (0.0, DEPTH - 0.001, 0.0, False),
        (1.9 * CLEARANCE, DEPTH + 0.001, 0.0, True),
        (2.1 * CLEARANCE, DEPTH + 0.001, 0.0, False),
        (OUTER + 0.03, RIM, 0.0, False),  # on the table, beside the block
        (0.0, DEPTH + 0.001, STRAIGHT - 0.01, True),
        (0.0, DEPTH + 0.001, STRAIGHT + 0.01, False),
    ):
        put(task, beside, depth, tilt)
        assert task.success() is done


def test_the_expert_lands_on_the_rim_and_slides_in(world):
    """Beside the hole it stands on the rim first, and feels it, with tens of newtons."""
    felt = []
    for seed in range(5):
        task = begin(PegInsertion, world, seed)
        start = len(world.wrench)
        assert perform(task, seed) is not None
        force = np.linalg.norm((world.wrench[start:] - world.tare_offset)[:, :3], axis=1)
        assert force.max() < 80.0
        felt.append((world.wrench[start:] - world.tare_offset)[:, 2].max())
    assert max(felt) > 15.0


def test_without_noise_the_peg_goes_straight_in(world):
    lengths = [perform(begin(PegInsertion, world, 7), seed, noise=0.0) for seed in (0, 1)]
    assert lengths[0] == lengths[1] is not None


def test_the_expert_finds_the_hole_again(world):
    """The block is pushed away from under the peg."""
    task = begin(PegInsertion, world, 4)
    x, y = task.scene.xy
    moved = []

    def disturb(step):
        if not moved and task.tip()[0][2] < 0.002:
            place(world, task.block, (x + 0.03, y + NEAR + 0.01, 0.5 * RIM), task.scene.yaw)
            moved.append(step)

    assert perform(task, disturb=disturb) is not None
    assert moved


def test_the_same_seed_gives_the_same_bytes_in_a_used_world(world):
    perform(begin(BlockPicking, world, 5))
    task = begin(PegInsertion, world, 6)
    used = perform(task, 6), world.wrench.tobytes()
    with World(world.config) as fresh:
        assert used == (perform(begin(PegInsertion, fresh, 6), 6), fresh.wrench.tobytes())
