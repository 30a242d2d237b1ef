"""Peg insertion: a round peg, in the gripper from the start, into a round hole."""

import math
from dataclasses import dataclass

import numpy as np

from collectors.simulation.bodies import MAX_PARTS, Box, Cylinder, Vector3
from collectors.simulation.bullet import pybullet
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves
from collectors.tasks.task import Task

RADIUS = 0.018  # [m] of the peg
CLEARANCE = 0.001  # [m] between peg and hole all round; Bullet's margins take nothing of it (test)
LENGTH = 0.06  # [m] of the peg, below its handle
HANDLE = 0.025  # [m] half the width of the square handle
MASS = 0.15  # [kg]
RIM = 0.05  # [m] height of the block
SIDES = MAX_PARTS  # of the polygon that stands for the round hole, which is its inscribed circle
OUTER = 0.055  # [m] radius of the block
MARGIN = 0.1  # [m] from the workspace's border, at least
DEPTH = 0.03  # [m] below the rim: the peg is in
STRAIGHT = 0.1  # [rad] from upright, at most
ABOVE = 0.008  # [m] above the rim: where the peg stops on its way to the hole
MISS = 0.004  # [m] by which the peg comes down beside the hole at noise 1, standard deviation
NEAR = 0.025  # [m] beside the hole: as far as sliding makes sense
BLOCK: Vector3 = (0.80, 0.76, 0.68)


@dataclass(frozen=True)
class Scene:
    """What is drawn: the hole alone, as in the paper.

    Attributes:
        xy: Middle of the hole, [m].
        yaw: Its yaw, [rad]: where the corners of the polygon are.
    """

    xy: tuple[float, float]
    yaw: float


class PegInsertion(Task):
    """Put a peg of 36 mm, held by a square handle, 3 cm deep into a hole of 38 mm at a varying place.

    The peg's frame is in its axis, between peg and handle. Its edges and the rim's are round, by Bullet's margin, so
    that it catches from 1.5 mm beside the middle.
    """

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """In the middle of the workspace, 20 cm wide (range of the reference benchmark)."""
        x, y = rng.uniform(world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN)
        return Scene(xy=(float(x), float(y)), yaw=float(rng.uniform(-np.pi, np.pi)))

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the block on the table and the peg into the gripper, which closes on it and holds it by friction."""
        self.world, self.scene = world, scene
        self.block = world.bodies.add(_ring(), (*scene.xy, 0.5 * RIM), scene.yaw, friction=0.25)
        peg = Cylinder(RADIUS, LENGTH, (0.0, 0.0, -0.5 * LENGTH), self.color)
        handle = Box((HANDLE, HANDLE, 0.02), (0.0, 0.0, 0.02), color=self.color)
        x, y, z = world.tcp[:3]
        place = (x, y, z - 0.01)  # the fingertips reach to 3 mm above the lower end of the handle
        self.body = world.bodies.add([peg, handle], place, mass=MASS, friction=1.0)
        holder = pybullet.createConstraint(
            self.body, -1, -1, -1, pybullet.JOINT_FIXED, (0, 0, 0), (0, 0, 0), place, physicsClientId=world.client
        )
        self._rest(2)
        pybullet.removeConstraint(holder, physicsClientId=world.client)
        self._rest(4)

    def _rest(self, steps: int) -> None:
        for _ in range(steps):
            self.world.step(np.zeros(5))

    def tip(self) -> tuple[np.ndarray, float]:
        """Middle of the peg's lower end, from the middle of the hole's rim, (3,) [m], and the peg's tilt, [rad]."""
        pose = self.world.pose(self.body)
        axis = np.array(pybullet.getMatrixFromQuaternion(pose[3:])).reshape(3, 3)[:, 2]
        rim = self.world.pose(self.block)[:3] + np.array([0.0, 0.0, 0.5 * RIM])
        return pose[:3] - LENGTH * axis - rim, math.acos(np.clip(axis[2], -1.0, 1.0))

    def success(self) -> bool:
        """The peg's lower end is in the hole, at least 3 cm deep, and the peg is upright within 6 degrees."""
        (x, y, z), tilt = self.tip()
        return bool(np.hypot(x, y) < 2.0 * CLEARANCE and z < -DEPTH and tilt < STRAIGHT)

    def expert(self, gripper: Gripper) -> Moves:
        """Near the hole, down until it is felt, slide until the peg drops in, push; again if that takes long.

        Ends when the peg is lost.
        """
        gripper.opening = 0.0
        while self.world.holds(self.body):
            yield from self._over(gripper, ABOVE + 0.03, loose=True)
            yield from self._over(gripper, ABOVE, miss=MISS)
            yield from gripper.go(z=self._to_hole()[2] - 0.01, speed=0.2, exact=True, until=lambda: self._lag() > 0.002)
            tries = 0
            while tries < 6 and self._off() < NEAR:
                tries += 1
                x, y, z = self._to_hole()
                if self._entered():
                    low = z - DEPTH - 0.008
                    yield from gripper.go(x, y, low, speed=0.6, until=lambda: self._lag() > 0.008)
                    yield from gripper.go(z=min(z, self.world.tcp[2]), exact=True)
                else:
                    yield from gripper.go(x, y, speed=0.2, exact=True, until=self._entered)

    def _over(self, gripper: Gripper, height: float, miss: float = 0.0, loose: bool = False) -> Moves:
        """Bring the tip over the hole, or near it, at a height above the rim: up first, never down on the way."""
        x, y, z = self._to_hole()
        yield from gripper.go(z=max(z + height, self.world.target[2]))
        x, y = gripper.vary([x, y], miss)
        yield from gripper.go(x, y, z + height, loose=loose)

    def _to_hole(self) -> np.ndarray:
        """Command, (3,) [m], that would bring the tip to the middle of the hole's rim if the gripper followed."""
        offset, _ = self.tip()
        return self.world.reference[:3] - offset

    def _entered(self) -> bool:
        """Whether the tip is in the hole."""
        return self._off() < 0.005 and bool(self.tip()[0][2] < -0.002)

    def _off(self) -> float:
        """How far the tip is beside the middle of the hole, [m]."""
        x, y, _ = self.tip()[0]
        return float(np.hypot(x, y))

    def _lag(self) -> float:
        """How far the gripper is held up above the reference, [m]; it takes 2500 N/m."""
        return float(self.world.tcp[2] - self.world.reference[2])


def _ring() -> list[Box]:
    """A block with a polygonal hole: boxes around it, each with its inner face on one side of the polygon."""
    middle, thick = 0.5 * (OUTER + RADIUS + CLEARANCE), 0.5 * (OUTER - RADIUS - CLEARANCE)
    half = (thick, OUTER * math.tan(math.pi / SIDES), 0.5 * RIM)
    turns = 2.0 * math.pi / SIDES * np.arange(SIDES)
    return [Box(half, (middle * math.cos(turn), middle * math.sin(turn), 0.0), turn, BLOCK) for turn in turns]
