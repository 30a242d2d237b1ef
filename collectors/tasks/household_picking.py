"""Household picking: lift an object of any shape out of a bin."""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.bodies import Box, quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.simulation.linear import length
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.household_objects import Lying, grasps, split
from collectors.tasks.task import Task

LIFTED = 0.1  # [m] height above the position in which the object lay
INNER = 0.18  # [m] half the bin's inner edge, which is 36 cm and lies inside the 40 cm workspace
WALL = 0.005  # [m] half the thickness of the bin's walls
RIM = 0.04  # [m] height of the bin's walls: the palm of a gripper that touches the floor is 5 cm above the floor
FLOOR = 0.003  # [m] height of the bin's floor
CLEAR = 0.02  # [m] from an object up to the TCP of a gripper that moves over it without dragging it along
SPREAD = 0.11  # [m] largest |x| and |y| from the bin's to the object's centre: an open gripper is clear of the walls
BIN_COLOR = (0.25, 0.27, 0.3)


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode.

    Attributes:
        name: Number of the object in random_urdfs, three digits.
        xy: Centre of the object in base, (x, y), [m].
        yaw: Yaw of the object relative to its orientation in the table of objects, [rad].
        mass: Mass of the object, [kg]: 0.1 to 0.2 kg (reference benchmark: 0.15).
        friction: Coulomb friction of the object, 0.5 to 0.7 (reference benchmark: 0.6).
    """

    name: str
    xy: tuple[float, float]
    yaw: float
    mass: float
    friction: float


class HouseholdPicking(Task):
    """Task to grasp an object of varying shape, place, yaw, mass and friction in a bin, and to lift it by 10 cm.

    Attributes:
        bin: Body id of the bin.
        rest_height: Height of the object's centre at the start, base z, [m].
    """

    part: ClassVar[str] = "train"
    """Part of the objects from which the object is drawn: ``train`` or ``test``."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with any object of `part`, anywhere in the bin that the gripper can reach."""
        chosen = split(cls.part)
        x, y = world.workspace[:2].mean(axis=1) + rng.uniform(-SPREAD, SPREAD, 2)
        return Scene(
            name=chosen[rng.integers(len(chosen))].name,
            xy=(float(x), float(y)),
            yaw=float(rng.uniform(-np.pi, np.pi)),
            mass=float(rng.uniform(0.1, 0.2)),
            friction=float(rng.uniform(0.5, 0.7)),
        )

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the bin on the table and the object into the bin, in the orientation in which it comes to rest."""
        self.world, self.scene = world, scene
        x, y = world.workspace[:2].mean(axis=1)
        self.bin = world.bodies.add(_bin(), (float(x), float(y), 0.0))
        lying = next(one for one in split(self.part) if one.name == scene.name)
        self.body = self._lay(lying)
        self.rest_height = float(world.pose(self.body)[2])

    def _lay(self, lying: Lying) -> int:
        world, scene = self.world, self.scene
        _, quat = pybullet.multiplyTransforms((0, 0, 0), quat_from_yaw(scene.yaw), (0, 0, 0), lying.quat_xyzw)
        body = world.bodies.add_urdf(lying.urdf, (*scene.xy, FLOOR + lying.height), quat)
        world.bodies.set_dynamics(body, mass=scene.mass, lateralFriction=scene.friction)
        return body

    def success(self) -> bool:
        """Return whether both fingers press on the object and its centre is more than 10 cm above its start."""
        return self.world.holds(self.body) and self.world.pose(self.body)[2] - self.rest_height > LIFTED

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that move over the best grasp, go down, close the fingers and lift the object.

        After a failure the expert tries another grasp. It finds the grasps anew from the object's present pose, and
        ends if there is none.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        failures = 0
        while True:
            pose = self.world.pose(self.body)
            found = grasps(self.scene.name, pose[:3], pose[3:], FLOOR, self.world.fingers)
            if not found:  # the object has tumbled and is too wide in its present orientation
                return
            grasp = found[7 * failures % len(found)]  # 7 apart, because grasps next to each other are nearly the same
            theta = nearest_turn(grasp.theta, np.pi, near=self.world.target[3])
            over = grasp.top + CLEAR
            yield from gripper.go(z=max(self.world.target[2], over))
            yield from gripper.go(*grasp.xyz[:2], over + 0.02, theta, loose=True)
            yield from gripper.go(*grasp.xyz[:2], over - 0.005, theta)
            yield from gripper.go(z=grasp.xyz[2], exact=True, until=partial(self._astray, pose))
            if not self._astray(pose):
                yield from gripper.grip(0.0, travels=1.5, until=self._held)
                yield from gripper.go(z=grasp.xyz[2] + LIFTED + 0.04, until=lambda: not self._held())
            yield from gripper.grip(1.0, travels=0.25)
            failures += 1

    def _held(self) -> bool:
        return self.world.holds(self.body)

    def _astray(self, expected: NDArray[np.float64]) -> bool:
        """Return whether the object has moved from the pose `expected` at which the gripper goes down to grasp it."""
        return length(self.world.pose(self.body)[:3] - expected[:3]) > 0.01


def _bin() -> list[Box]:
    """Return the bin's floor and four walls, with the origin in the middle of the floor's underside."""
    outer, middle = INNER + 2 * WALL, INNER + WALL
    walls = [
        Box(half, (x * middle, y * middle, 0.5 * RIM), color=BIN_COLOR)
        for x, y, half in (
            (1, 0, (WALL, outer, 0.5 * RIM)),
            (-1, 0, (WALL, outer, 0.5 * RIM)),
            (0, 1, (INNER, WALL, 0.5 * RIM)),
            (0, -1, (INNER, WALL, 0.5 * RIM)),
        )
    ]
    return [Box((INNER, INNER, 0.5 * FLOOR), (0.0, 0.0, 0.5 * FLOOR), color=BIN_COLOR), *walls]
