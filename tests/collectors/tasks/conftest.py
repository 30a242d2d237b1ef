"""Worlds for the task tests: an ideal sensor and no cameras that cost time."""

from collections.abc import Iterator

import numpy as np
import pybullet
import pytest

from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import MAX_STEPS, Task

AGAIN = 80
"""Steps for an expert whose work is undone after some 20 of them."""


@pytest.fixture
def world() -> Iterator[World]:
    with World(WorldConfig(noise=NoiseConfig.none(), cameras={"front": CameraConfig(height=24, width=24)})) as world:
        yield world


def begin(task: type[Task], world: World, seed: int = 0) -> Task:
    """A scene of a task, set up."""
    return task.begin(world, np.random.SeedSequence([seed]))


def perform(task: Task, seed: int = 0, noise: float = 1.0, steps: int = MAX_STEPS, disturb=None) -> int | None:
    """Let the expert act; returns the steps it took, or None if it did not succeed.

    `disturb` is called after every step with the number of steps so far.
    """
    moves = task.expert(Gripper(task.world, np.random.default_rng(seed), noise))
    for step in range(1, steps + 1):
        if (action := next(moves, None)) is None:
            return None
        task.world.step(action)
        if task.success():
            return step
        if disturb:
            disturb(step)
    return None


def place(world: World, body: int, position, yaw: float = 0.0) -> None:
    """Put a body somewhere at once, at rest."""
    quat = pybullet.getQuaternionFromEuler((0.0, 0.0, yaw))
    pybullet.resetBasePositionAndOrientation(body, position, quat, physicsClientId=world.client)
    pybullet.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0), physicsClientId=world.client)
