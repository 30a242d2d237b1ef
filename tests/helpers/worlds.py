"""Moving in simulated worlds, and letting experts act in them."""

import numpy as np
import pybullet

from collectors.simulation import World
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import MAX_STEPS, Task

AGAIN = 80
"""Steps for an expert whose work is undone after some 20 of them."""


def hold(world: World, ticks: int, opening: float = 1.0) -> None:
    """Rest for a while."""
    for _ in range(ticks):
        world.step([opening, 0.0, 0.0, 0.0, 0.0])


def move(world: World, goal: tuple[float, float, float, float], opening: float = 1.0, stride: float = 1.0) -> None:
    """Command the TCP from where it is commanded to be (x, y, z, theta) in steps of at most `stride` of the bound."""
    bounds = [world.config.max_move * stride] * 3 + [world.config.max_turn * stride]
    ticks = max(1, *(int(abs(g - t) / b + 0.999999) for g, t, b in zip(goal, world.target, bounds, strict=True)))
    step = [(g - t) / ticks for g, t in zip(goal, world.target, strict=True)]
    for _ in range(ticks):
        world.step([opening, *step])


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
