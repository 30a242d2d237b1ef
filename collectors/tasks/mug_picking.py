"""Mug picking: lift a mug by its handle."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pybullet_data
from numpy.typing import ArrayLike, NDArray

from collectors.simulation.bodies import quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.simulation.linear import length, product
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

LIFTED = 0.1  # [m] by which the centre of mass must rise, as in block picking
MARGIN = 0.08  # [m] from the mug's axis to the workspace's border, at least: the whole mug is inside at any yaw
CLEAR = 0.02  # [m] from the mug's rim up to the TCP of a gripper that moves over it

# Measured on objects/mug_col.obj of pybullet_data, at scale 1, in the axes of the mesh: the axis of the mug is z, its
# bottom is at z = 0, and the handle points to +y. The handle is made of five convex parts. The cup is one convex part
# and therefore solid: nothing fits inside.
CUP = 0.041  # [m] radius of the cup
TOLERANCE = 0.003  # [m] by which contact points may be outside the handle's box: shape margin and surface deflection
HANDLE = np.array(
    [[-0.0055, 0.0055], [CUP + TOLERANCE, 0.0806], [0.0165, 0.0835]]
)  # [m] box round the part of the handle that is off the cup: low and high bound of x, y and z
RIM = 0.1  # [m] height of the rim
GRASP = np.array([0.0, 0.060, 0.072])  # [m] TCP of a grasp: fingers left and right of the upper bar, 1 cm off the cup
CLEARANCE = 0.01  # [m] from the rim up to the palm, at least
MASS_CENTRE = np.array([0.0, 0.003, 0.044])  # [m] that of the visual mesh as a solid; in the file it is at the bottom


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode.

    The reference benchmark varies only the mug's place and, by +-45 degrees, its yaw.

    Attributes:
        xy: Position of the mug's axis in base, (x, y), [m].
        yaw: Yaw of the mug, [rad], drawn from the full circle. At 0 the handle points to base +y.
        scale: Size of the mug relative to a diameter of 8.2 cm and a height of 10 cm, 0.8 to 1.1.
        mass: Mass of the mug, [kg]: 0.2 to 0.4 kg (the file has 1 kg).
        friction: Coulomb friction of the mug, 0.5 to 1. The fingers have 1, the table has 0.5, and a contact has the
            product of both bodies' values.
    """

    xy: tuple[float, float]
    yaw: float
    scale: float
    mass: float
    friction: float


class MugPicking(Task):
    """Task to grasp a mug of varying place, yaw, size, mass and friction by its handle, and to lift it by 10 cm."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene with the mug anywhere on the table in the workspace, at any yaw."""
        x, y = rng.uniform(world.workspace[:2, 0] + MARGIN, world.workspace[:2, 1] - MARGIN)
        return Scene(
            xy=(float(x), float(y)),
            yaw=float(rng.uniform(-np.pi, np.pi)),
            scale=float(rng.uniform(0.8, 1.1)),
            mass=float(rng.uniform(0.2, 0.4)),
            friction=float(rng.uniform(0.5, 1.0)),
        )

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the mug on the table."""
        self.world, self.scene = world, scene
        self.body = world.bodies.add_urdf(mug_urdf(), (*scene.xy, 0.0), quat_from_yaw(scene.yaw), scale=scene.scale)
        world.bodies.set_dynamics(self.body, mass=scene.mass, lateralFriction=scene.friction)

    def success(self) -> bool:
        """Return whether both fingers press on the mug's handle only and its centre of mass is more than 10 cm higher.

        The height is compared with that of the mug standing on the table. It does not matter how far the mug swings
        round the fingers.
        """
        height = self.world.pose(self.body)[2] - self.scene.scale * MASS_CENTRE[2]
        return bool(height > LIFTED) and self.by_handle()

    def by_handle(self) -> bool:
        """Return whether both fingers press on the mug, and only on its handle."""
        for finger in self.world.finger_links:
            points = self._pressed(finger)
            inside = (points >= HANDLE[:, 0] - TOLERANCE) & (points <= HANDLE[:, 1] + TOLERANCE)
            if not (points.size and inside.all()):
                return False
        return True

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that move over the handle, fingers across it, go down, close the fingers and lift the mug.

        The expert starts again if the handle slips or the mug is no longer where it was.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        while True:
            pose = self.world.pose(self.body)
            x, y, z = self.in_base(GRASP)
            rim = self.scene.scale * RIM
            theta = nearest_turn(self.world.yaw(self.body) + np.pi / 2, np.pi)
            yield from gripper.go(z=max(self.world.target[2], rim + CLEAR))
            yield from gripper.go(x, y, rim + 0.04, theta, loose=True)
            yield from gripper.go(x, y, rim + 0.01, theta)
            yield from gripper.go(
                z=max(z, rim - (self.world.fingers.palm - CLEARANCE)), exact=True, until=partial(self._astray, pose)
            )
            if not self._astray(pose):
                yield from gripper.grip(0.0, travels=1.25, until=self.by_handle)
                yield from gripper.go(z=z + LIFTED + 0.06, until=lambda: not self.by_handle())
            yield from gripper.grip(1.0, travels=0.5)

    def in_base(self, point: ArrayLike) -> NDArray[np.float64]:
        """Return the present position in base, (3,), [m], of a point of the mug.

        Args:
            point: The point in the axes of the mug's mesh at scale 1, (3,), [m].
        """
        position, rotation = self._frame()
        moved: NDArray[np.float64] = position + product(rotation, self.scene.scale * (np.asarray(point) - MASS_CENTRE))
        return moved

    def _pressed(self, finger: int) -> NDArray[np.float64]:
        """Return the points where a finger presses on the mug, (N, 3), [m], in the axes of the mesh at scale 1."""
        contacts = pybullet.getContactPoints(
            self.world.robot, self.body, linkIndexA=finger, physicsClientId=self.world.client
        )
        points = [contact[6] for contact in contacts if contact[9] > 0.0]  # 6: position on the mug, 9: normal force
        position, rotation = self._frame()
        return product(np.reshape(points, (-1, 3)) - position, rotation) / self.scene.scale + MASS_CENTRE

    def _frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return, in base, the mug's centre of mass, (3,), [m], and the axes of its mesh as columns, (3, 3)."""
        pose = self.world.pose(self.body)
        return pose[:3], np.reshape(pybullet.getMatrixFromQuaternion(pose[3:]), (3, 3))

    def _astray(self, expected: NDArray[np.float64]) -> bool:
        """Return whether the mug has moved from the pose `expected` at which the gripper goes down for the handle."""
        return length(self.world.pose(self.body)[:3] - expected[:3]) > 0.01


def mug_urdf() -> str:
    """Return the URDF text of pybullet_data's mug, with absolute mesh paths and with the centre of mass corrected."""
    file = Path(pybullet_data.getDataPath()) / "objects" / "mug.urdf"
    centre = " ".join(map(str, MASS_CENTRE))
    text = file.read_text().replace('filename="', f'filename="{file.parent}/')
    return text.replace('<origin xyz="0 0 0"/>', f'<origin xyz="{centre}"/>', 1)  # the first one is the inertia's
