"""Peg insertion: put a round peg, which the gripper holds from the start, into a round hole."""

import math
from dataclasses import dataclass

import numpy as np

from collectors.simulation.bodies import MAX_PARTS, Box, Cylinder, Vector3
from collectors.simulation.bullet import pybullet
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, travel_steps
from collectors.tasks.task import Task

RADIUS = 0.018  # [m] radius of the peg
CLEARANCE = 0.001  # [m] between peg and hole all round; Bullet's shape margins do not reduce it (there is a test)
LENGTH = 0.06  # [m] length of the peg below its handle
HANDLE = 0.025  # [m] half the width of the square handle
MASS = 0.15  # [kg] mass of the peg with its handle
RIM = 0.05  # [m] height of the block with the hole
SIDES = MAX_PARTS  # number of sides of the polygon that stands for the round hole, which is its inscribed circle
OUTER = 0.055  # [m] radius of the block with the hole
MARGIN = 0.1  # [m] from the hole to the workspace's border, at least
DEPTH = 0.03  # [m] below the rim at which the peg counts as inserted
STRAIGHT = 0.1  # [rad] largest tilt of the peg at success
ABOVE = 0.008  # [m] height of the peg's tip above the rim where the peg stops on its way to the hole
MISS = 0.004  # [m] standard deviation, at noise 1, of the point beside the hole where the peg comes down
NEAR = 0.025  # [m] from the tip to the hole, beyond which sliding is not worth trying
BLOCK: Vector3 = (0.80, 0.76, 0.68)


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode. Only the hole varies, as in the paper.

    Attributes:
        xy: Middle of the hole in base, (x, y), [m].
        yaw: Yaw of the block with the hole, [rad], which turns the corners of the polygon.
    """

    xy: tuple[float, float]
    yaw: float


class PegInsertion(Task):
    """Task to put a peg of 36 mm, held by a square handle, 3 cm deep into a hole of 38 mm at a varying place.

    The origin of the peg's frame is on the peg's axis, between peg and handle. The edges of the peg and of the hole's
    rim are rounded by Bullet's shape margin, so that the peg slides in from 1.5 mm beside the middle.

    Attributes:
        block: Body id of the block with the hole.
    """

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with the hole in the middle 20 cm of the workspace, as in the reference benchmark."""
        x, y = rng.uniform(world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN)
        return Scene(xy=(float(x), float(y)), yaw=float(rng.uniform(-np.pi, np.pi)))

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the block on the table and the peg into the gripper, which closes on the peg and holds it by friction."""
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
        self._rest(0.5)
        pybullet.removeConstraint(holder, physicsClientId=world.client)
        self._rest(1.0)

    def _rest(self, travels: float) -> None:
        for _ in range(travel_steps(self.world, travels)):
            self.world.step(np.zeros(5))

    def tip(self) -> tuple[np.ndarray, float]:
        """Return the position of the peg's tip and the peg's tilt.

        Returns:
            Middle of the peg's lower end relative to the middle of the hole's rim, base axes, (3,), [m], and the angle
            between the peg's axis and the vertical, [rad].
        """
        pose = self.world.pose(self.body)
        axis = np.array(pybullet.getMatrixFromQuaternion(pose[3:])).reshape(3, 3)[:, 2]
        rim = self.world.pose(self.block)[:3] + np.array([0.0, 0.0, 0.5 * RIM])
        return pose[:3] - LENGTH * axis - rim, math.acos(np.clip(axis[2], -1.0, 1.0))

    def success(self) -> bool:
        """Return whether the peg is upright within 6 degrees and its lower end is more than 3 cm deep in the hole."""
        (x, y, z), tilt = self.tip()
        return bool(np.hypot(x, y) < 2.0 * CLEARANCE and z < -DEPTH and tilt < STRAIGHT)

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that go down near the hole until the peg touches, slide it until it drops in, and push it down.

        The expert starts again if sliding takes long, and ends when the fingers no longer hold the peg.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
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
        """Bring the tip over the hole, or near it.

        If the tip is lower than the height, the gripper moves up first, so that the tip is not lower on its way.

        Args:
            gripper: Gripper that makes the actions.
            height: Height of the tip above the hole's rim, [m].
            miss: Standard deviation of the distance from the hole at noise 1, in x and in y, [m].
            loose: Whether the goal is approximate.
        """
        x, y, z = self._to_hole()
        yield from gripper.go(z=max(z + height, self.world.target[2]))
        x, y = gripper.vary([x, y], miss)
        yield from gripper.go(x, y, z + height, loose=loose)

    def _to_hole(self) -> np.ndarray:
        """Return the command in base, (3,), [m], that brings an unblocked tip to the middle of the hole's rim."""
        offset, _ = self.tip()
        return self.world.reference[:3] - offset

    def _entered(self) -> bool:
        """Return whether the tip is in the hole."""
        return self._off() < 0.005 and bool(self.tip()[0][2] < -0.002)

    def _off(self) -> float:
        """Return the horizontal distance between the tip and the middle of the hole, [m]."""
        x, y, _ = self.tip()[0]
        return float(np.hypot(x, y))

    def _lag(self) -> float:
        """Return the height by which the gripper is held up above the reference, [m], at a stiffness of 2500 N/m."""
        return float(self.world.tcp[2] - self.world.reference[2])


def _ring() -> list[Box]:
    """Return a block with a polygonal hole, made of boxes whose inner faces are the sides of the polygon."""
    middle, thick = 0.5 * (OUTER + RADIUS + CLEARANCE), 0.5 * (OUTER - RADIUS - CLEARANCE)
    half = (thick, OUTER * math.tan(math.pi / SIDES), 0.5 * RIM)
    turns = 2.0 * math.pi / SIDES * np.arange(SIDES)
    return [Box(half, (middle * math.cos(turn), middle * math.sin(turn), 0.0), turn, BLOCK) for turn in turns]
