"""Mug picking: lift a mug by its handle."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pybullet_data
from numpy.typing import ArrayLike, NDArray

from collectors.simulation.arms.panda import LEFT_FINGER, RIGHT_FINGER
from collectors.simulation.bodies import quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

LIFTED = 0.1  # [m] that the centre of mass must rise, as in block picking
MARGIN = 0.08  # [m] between the mug's axis and the workspace's border: the whole mug is inside, whatever its yaw
CLEAR = 0.02  # [m] between the TCP of a travelling gripper and the rim

# Measured on objects/mug_col.obj of pybullet_data, at scale 1, in the axes of the mesh: the axis of the mug is z, its
# bottom at z = 0, the handle points to +y and is five convex parts. The cup is one, hence solid: nothing fits inside.
CUP = 0.041  # [m], its radius
TOLERANCE = 0.003  # [m] by which contact points may leave the handle's box: a margin of the shape, and a surface gives
HANDLE = np.array(
    [[-0.0055, 0.0055], [CUP + TOLERANCE, 0.0806], [0.0165, 0.0835]]
)  # [m], box round what is off the cup
RIM = 0.1  # [m], height
GRASP = np.array([0.0, 0.060, 0.072])  # [m], of the TCP: fingers left and right of the upper bar, 1 cm off the cup
PALM = 0.03  # [m] that the TCP must at most be below the rim, so that the palm, 39 mm above it, does not touch
MASS_CENTRE = np.array([0.0, 0.003, 0.044])  # [m], of the visual mesh as a solid; the file has it at the bottom


@dataclass(frozen=True)
class Scene:
    """What is drawn (the reference benchmark varies only place and, by +-45 degrees, yaw).

    Attributes:
        xy: The mug's axis, [m].
        yaw: Yaw, [rad], full circle; at 0 the handle points to +y.
        scale: Size relative to a mug of 8.2 cm in diameter and 10 cm in height, 0.8 to 1.1.
        mass: 0.2 to 0.4 kg (the file has 1 kg).
        friction: Its Coulomb friction, 0.5 to 1; the fingers have 1, the table 0.5, contact has the product.
    """

    xy: tuple[float, float]
    yaw: float
    scale: float
    mass: float
    friction: float


class MugPicking(Task):
    """Grasp a mug of varying place, yaw, size, mass and friction by its handle, and lift it by 10 cm."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Anywhere on the workspace's table, any way round."""
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
        """Both fingers press on the handle and on nothing else of the mug, whose centre of mass is 10 cm higher.

        How far the mug swings round the fingers does not matter.
        """
        height = self.world.pose(self.body)[2] - self.scene.scale * MASS_CENTRE[2]
        return bool(height > LIFTED) and self.by_handle()

    def by_handle(self) -> bool:
        """Whether both fingers press on the mug, only on its handle."""
        for finger in (LEFT_FINGER, RIGHT_FINGER):
            points = self._pressed(finger)
            inside = (points >= HANDLE[:, 0] - TOLERANCE) & (points <= HANDLE[:, 1] + TOLERANCE)
            if not (points.size and inside.all()):
                return False
        return True

    def expert(self, gripper: Gripper) -> Moves:
        """Over the handle, fingers across it, down, close, up; again if it slips or is not where it was."""
        while True:
            pose = self.world.pose(self.body)
            x, y, z = self.in_base(GRASP)
            rim = self.scene.scale * RIM
            theta = nearest_turn(self.world.yaw(self.body) + np.pi / 2, np.pi)
            yield from gripper.go(z=max(self.world.target[2], rim + CLEAR))
            yield from gripper.go(x, y, rim + 0.04, theta, loose=True)
            yield from gripper.go(x, y, rim + 0.01, theta)
            yield from gripper.go(z=max(z, rim - PALM), exact=True, until=partial(self._astray, pose))
            if not self._astray(pose):
                yield from gripper.grip(0.0, steps=5, until=self.by_handle)
                yield from gripper.go(z=z + LIFTED + 0.06, until=lambda: not self.by_handle())
            yield from gripper.grip(1.0, steps=2)

    def in_base(self, point: ArrayLike) -> NDArray[np.float64]:
        """A point of the mesh at scale 1, (3,) [m], in base, (3,) [m]."""
        position, rotation = self._frame()
        moved: NDArray[np.float64] = position + rotation @ (self.scene.scale * (np.asarray(point) - MASS_CENTRE))
        return moved

    def _pressed(self, finger: int) -> NDArray[np.float64]:
        """Where a finger presses on the mug, (N, 3), [m], in the axes of the mesh at scale 1."""
        contacts = pybullet.getContactPoints(
            self.world.robot, self.body, linkIndexA=finger, physicsClientId=self.world.client
        )
        points = [contact[6] for contact in contacts if contact[9] > 0.0]  # 6: on the mug, 9: normal force
        position, rotation = self._frame()
        return (np.reshape(points, (-1, 3)) - position) @ rotation / self.scene.scale + MASS_CENTRE

    def _frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The mug's centre of mass (3,) [m] and the axes of its mesh as columns (3, 3), in base."""
        pose = self.world.pose(self.body)
        return pose[:3], np.reshape(pybullet.getMatrixFromQuaternion(pose[3:]), (3, 3))

    def _astray(self, expected: NDArray[np.float64]) -> bool:
        """Whether the mug is no longer where the gripper goes down for its handle."""
        return bool(np.linalg.norm(self.world.pose(self.body)[:3] - expected[:3]) > 0.01)


def mug_urdf() -> str:
    """pybullet_data's mug as text with absolute mesh paths and with the centre of mass where it belongs."""
    file = Path(pybullet_data.getDataPath()) / "objects" / "mug.urdf"
    centre = " ".join(map(str, MASS_CENTRE))
    text = file.read_text().replace('filename="', f'filename="{file.parent}/')
    return text.replace('<origin xyz="0 0 0"/>', f'<origin xyz="{centre}"/>', 1)  # the first one is the inertia's
