"""Block pulling: pull one of two flat blocks to the other."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from collectors.simulation.bodies import RED
from collectors.simulation.bullet import pybullet
from collectors.simulation.centering import FINGERTIP
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task, two_apart

HEIGHT = 0.05  # [m] of both blocks
APART = 0.2  # [m] between the centres, at least; the largest blocks are 0.14 m across the corners
LYING = 0.005  # [m] that a block's centre may be higher than on the table
MARGIN = 0.06  # [m] of the centres from the workspace's border, at least
OPENING = 0.5  # of the pressing gripper: tips 7 cm across do not let the block turn
PRESS = 0.009  # [m] of the command below contact: 22 N, of which the table takes half as friction
OVER = 0.015  # [m] of the fingertips above the block before pressing
SLIPPED = 0.02  # [m] of the gripper over the block, when the fingers slide on it


@dataclass(frozen=True)
class Scene:
    """What is drawn (ranges of the reference benchmark, which the paper uses), first the pulled block, then the other.

    Attributes:
        xy: Centres, [m], at least 20 cm apart.
        yaw: Yaws, [rad].
        half: Half the edges of the square bases, [m]: 10 cm scaled by 0.75 to 1.
        mass: 0.05 to 0.15 kg.
        friction: Coulomb friction, 0.9 to 1; the fingers have 1, the table 0.5, contact has the product.
    """

    xy: tuple[tuple[float, float], tuple[float, float]]
    yaw: tuple[float, float]
    half: tuple[float, float]
    mass: tuple[float, float]
    friction: tuple[float, float]


class BlockPulling(Task):
    """Pull a flat block of varying place, yaw, size, mass and friction across the table until it touches another."""

    other_color = RED
    scene: Scene
    other: int

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Both blocks anywhere on the workspace's table, redrawn until far enough apart."""
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
        """The two blocks press on each other, side by side on the table; whichever was moved, and however."""
        if max(self.world.pose(block)[2] for block in (self.body, self.other)) > HEIGHT / 2 + LYING:
            return False
        contacts = pybullet.getContactPoints(self.body, self.other, physicsClientId=self.world.client)
        return any(contact[9] > 0.0 for contact in contacts)  # 9: normal force

    def state(self) -> Mapping[str, np.ndarray]:
        """The pulled block's pose, and the other's, (7,)."""
        return {**super().state(), "other": self.world.pose(self.other)}

    def expert(self, gripper: Gripper) -> Moves:
        """Press half-open fingers on the block and drag it to the other; again if they slip or the block is away."""
        touch = HEIGHT + FINGERTIP
        while True:
            block, other = self.world.pose(self.body)[:2], self.world.pose(self.other)[:2]
            way = other - block
            theta = nearest_turn(math.atan2(way[1], way[0]), np.pi)
            yield from gripper.grip(OPENING, steps=0)
            yield from gripper.go(z=max(self.world.target[2], touch + OVER))
            x, y = gripper.vary(block, 0.005)
            yield from gripper.go(x, y, touch + OVER, theta)
            pressed = self.world.target[:2] - block
            yield from gripper.go(z=touch - float(gripper.vary(PRESS, 0.001)), speed=0.3, exact=True)
            yield from gripper.go(*other, speed=0.8, exact=True, until=partial(self._slipped, pressed))

    def _slipped(self, pressed: np.ndarray) -> bool:
        """Whether the gripper is no longer where it pressed on the block, `pressed` from its centre."""
        return bool(np.linalg.norm(self.world.tcp[:2] - self.world.pose(self.body)[:2] - pressed) > SLIPPED)
