"""Block pushing: push a block across the table to a goal that is marked on the table."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.bodies import RED, Box
from collectors.simulation.linear import length, sum_of_products
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task, two_apart

REACHED = 0.05  # [m] horizontal distance from block to goal below which the goal is reached
LYING = 0.005  # [m] by which the block's centre may be higher than on the table
APART = 0.2  # [m] from start to goal, at least
MARGIN = 0.07  # [m] from start and goal to the workspace's border, at least: room for the gripper behind the block
GOAL_COLOR = (0.1, 0.3, 0.9)
CLEAR = 0.02  # [m] from an object up to the TCP of a gripper that moves over it without dragging it along
LOW = 0.014  # [m] height of the pushing TCP: the tips are below the smallest block's middle and off the table
BEHIND = 0.05  # [m] from the block's middle back to the TCP before a push: half its diagonal, half a finger and 4 mm
OPENING = 0.25  # opening of the pushing gripper: two fingers 2 cm apart steer a block, and no block slips between them
ASIDE = 0.018  # [m] from the gripper's path to the block's middle at which further pushing would turn the block away


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode, in the ranges of the reference benchmark, which the paper uses.

    Attributes:
        xy: Centre of the block in base, (x, y), [m].
        yaw: Yaw of the block, [rad].
        half: Half the block's edge, [m]. The block is a 5 cm cube scaled by 0.75 to 1.
        mass: Mass of the block, [kg]: 0.05 to 0.15 kg.
        friction: Coulomb friction of the block, 0.9 to 1. The fingers have 1, the table has 0.5, and a contact has the
            product of both bodies' values.
        goal: Goal of the block's centre in base, (x, y), [m], at least 20 cm from `xy`.
    """

    xy: tuple[float, float]
    yaw: float
    half: float
    mass: float
    friction: float
    goal: tuple[float, float]


class BlockPushing(Task):
    """Task to push a cube of varying place, yaw, size, mass and friction to within 5 cm of a mark."""

    color = RED
    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with start and goal anywhere with room for the gripper, redrawn until they are apart enough."""
        low, high = world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN
        start, goal = two_apart(rng, low, high, APART)
        return Scene(
            xy=(float(start[0]), float(start[1])),
            yaw=float(rng.uniform(-np.pi / 4, np.pi / 4)),
            half=float(0.025 * rng.uniform(0.75, 1.0)),
            mass=float(rng.uniform(0.05, 0.15)),
            friction=float(rng.uniform(0.9, 1.0)),
            goal=(float(goal[0]), float(goal[1])),
        )

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the block on the table, and at the goal a flat mark that nothing can touch.

        The half edge of the mark is the distance below which the goal counts as reached.
        """
        self.world, self.scene = world, scene
        half = scene.half
        self.body = world.add_box(
            (half, half, half), (*scene.xy, half), scene.yaw, scene.mass, scene.friction, self.color
        )
        mark = Box((REACHED, REACHED, 0.0005), color=GOAL_COLOR)
        world.bodies.add([mark], (*scene.goal, 0.0005), collide=False)

    def success(self) -> bool:
        """Return whether the block's centre is within 5 cm of the goal, horizontally, and the block is on the table."""
        x, y, z, *_ = self.world.pose(self.body)
        return math.dist((x, y), self.scene.goal) < REACHED and z < self.scene.half + LYING

    def state(self) -> Mapping[str, np.ndarray]:
        """Return the block's pose, (7,): position [m] and quat_xyzw, and the goal, (3,), [m], both in base."""
        return {**super().state(), "goal": np.array([*self.scene.goal, 0.0])}

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that go down behind the block and push it straight to the goal.

        The expert starts again if the block slips aside.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        goal = np.array(self.scene.goal)
        while True:
            block = self.world.pose(self.body)[:2]
            way = (goal - block) / length(goal - block)
            theta = nearest_turn(math.atan2(way[1], way[0]), np.pi)
            start = block - BEHIND * way
            top = 2 * self.scene.half
            yield from gripper.grip(OPENING, travels=0)
            yield from gripper.go(z=max(self.world.target[2], top + CLEAR))
            x, y = gripper.vary(start, 0.004)
            yield from gripper.go(x, y, top + CLEAR, theta)
            x, y = start
            yield from gripper.go(x, y, LOW, exact=True)
            yield from gripper.go(*gripper.vary(goal, 0.006), exact=True, until=partial(self._aside, start, way))

    def _aside(self, start: np.ndarray, way: np.ndarray) -> bool:
        """Return whether the block is no longer in front of a gripper that moves from `start` along `way`."""
        block = self.world.pose(self.body)[:2]
        aside = sum_of_products(block - start, (-way[1], way[0]))
        return bool(abs(aside) > ASIDE or sum_of_products(block - self.world.tcp[:2], way) < 0.0)
