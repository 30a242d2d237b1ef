"""Block pulling: pull one of two flat blocks to the other block."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.bodies import RED
from collectors.simulation.bullet import pybullet
from collectors.simulation.linear import length
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task, two_apart

HEIGHT = 0.05  # [m] height of both blocks
APART = 0.2  # [m] between the blocks' centres, at least; the largest blocks are 0.14 m across the corners
LYING = 0.005  # [m] by which a block's centre may be higher than on the table
MARGIN = 0.06  # [m] from the blocks' centres to the workspace's border, at least
OPENING = 0.5  # opening of the pressing gripper: tips 7 cm across do not let the block turn
PRESS = 0.009  # [m] depth of the command below contact: 22 N, half of which the table's friction takes
OVER = 0.015  # [m] height of the fingertips above the block before they press
SLIPPED = 0.02  # [m] by which the gripper moves over the block when the fingers slide on it


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode, in the ranges of the reference benchmark, which the paper uses.

    Each pair holds the value of the pulled block, then the value of the other block.

    Attributes:
        xy: Centres of the blocks in base, (x, y) each, [m], at least 20 cm apart.
        yaw: Yaws of the blocks, [rad].
        half: Half the edges of the blocks' square bases, [m]. The edges are 10 cm scaled by 0.75 to 1.
        mass: Masses of the blocks, [kg]: 0.05 to 0.15 kg.
        friction: Coulomb frictions of the blocks, 0.9 to 1. The fingers have 1, the table has 0.5, and a contact has
            the product of both bodies' values.
    """

    xy: tuple[tuple[float, float], tuple[float, float]]
    yaw: tuple[float, float]
    half: tuple[float, float]
    mass: tuple[float, float]
    friction: tuple[float, float]


class BlockPulling(Task):
    """Task to pull a flat block across the table until it touches another flat block.

    Both blocks vary in place, yaw, size, mass and friction.

    Attributes:
        other: Body id of the block that is not pulled.
        other_color: RGB of the block that is not pulled, 0 to 1.
    """

    other_color = RED
    scene: Scene
    other: int

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with both blocks anywhere on the table in the workspace, redrawn until they are apart enough."""
        low, high = world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN
        xy = two_apart(rng, low, high, APART)

        def two(low: float, high: float) -> tuple[float, float]:
            first, second = rng.uniform(low, high, 2).tolist()
            return first, second

        return Scene(
            xy=((float(xy[0, 0]), float(xy[0, 1])), (float(xy[1, 0]), float(xy[1, 1]))),
            yaw=two(-np.pi / 4, np.pi / 4),
            half=two(0.0375, 0.05),
            mass=two(0.05, 0.15),
            friction=two(0.9, 1.0),
        )

    def __init__(self, world: World, scene: Scene) -> None:
        """Put both blocks on the table."""
        self.world, self.scene = world, scene
        self.body, self.other = (
            world.add_box((half, half, HEIGHT / 2), (*xy, HEIGHT / 2), yaw, mass, friction, color)
            for xy, yaw, half, mass, friction, color in zip(
                scene.xy, scene.yaw, scene.half, scene.mass, scene.friction, (self.color, self.other_color), strict=True
            )
        )

    def success(self) -> bool:
        """Return whether the two blocks press on each other while both lie on the table.

        It does not matter which block was moved, and how.
        """
        if max(self.world.pose(block)[2] for block in (self.body, self.other)) > HEIGHT / 2 + LYING:
            return False
        contacts = pybullet.getContactPoints(self.body, self.other, physicsClientId=self.world.client)
        return any(contact[9] > 0.0 for contact in contacts)  # field 9 is the normal force

    def state(self) -> Mapping[str, np.ndarray]:
        """Return the poses of the pulled and of the other block in base, each (7,): position [m] and quat_xyzw."""
        return {**super().state(), "other": self.world.pose(self.other)}

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that press half-open fingers on the block and drag it to the other block.

        The expert starts again if the fingers slip on the block.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        touch = HEIGHT + self.world.fingers.tip
        while True:
            block, other = self.world.pose(self.body)[:2], self.world.pose(self.other)[:2]
            way = other - block
            theta = nearest_turn(math.atan2(way[1], way[0]), np.pi)
            yield from gripper.grip(OPENING, travels=0)
            yield from gripper.go(z=max(self.world.target[2], touch + OVER))
            x, y = gripper.vary(block, 0.005)
            yield from gripper.go(x, y, touch + OVER, theta)
            pressed = self.world.target[:2] - block
            yield from gripper.go(z=touch - float(gripper.vary(PRESS, 0.001)), speed=0.3, exact=True)
            yield from gripper.go(*other, speed=0.8, exact=True, until=partial(self._slipped, pressed))

    def _slipped(self, pressed: np.ndarray) -> bool:
        """Return whether the TCP has left the point, `pressed` from the block's centre, (2,), [m], that it pressed."""
        return length(self.world.tcp[:2] - self.world.pose(self.body)[:2] - pressed) > SLIPPED
