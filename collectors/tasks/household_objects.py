"""Objects of `pybullet_data`'s random_urdfs that stand for household objects, how they lie, and where to grasp them.

    .venv/bin/python -m collectors.tasks.household_objects      # rewrites household_objects.csv

random_urdfs are 1000 procedural shapes, each made of convex pieces in one OBJ file. An object is put down in the
orientation of its file, and lies in the orientation in which it comes to rest. The object is graspable if

- it comes to rest within 3 s, without rolling further than 5 cm,
- it is 25 to 85 mm high and reaches at most 90 mm from its centre, horizontally, so that it fits the bin and the
  gripper, and
- it has a grasp for the Panda's hand: a place where it is at most 68 mm wide between the fingers, which open to 80 mm,
  where both fingers meet it at less than 26 degrees from its surface normal, and which is at most 2 cm from its centre,
  horizontally.

The table household_objects.csv holds the graspable objects and how they lie, so that a process need not try all 1000.
"""

import csv
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pybullet_data
from numpy.typing import NDArray

from collectors.simulation.bullet import pybullet
from collectors.simulation.grippers.gripper import Fingers
from collectors.simulation.grippers.panda_hand import panda_fingers
from collectors.simulation.grippers.parallel import GripperConfig
from collectors.simulation.linear import length, product, sum_of_products

FOLDER = Path(pybullet_data.getDataPath()) / "random_urdfs"
TABLE = Path(__file__).with_suffix(".csv")
COUNT = 1000

SCALE = 0.015  # [m] per unit of the OBJ files, the same in all URDFs
HEIGHT = (0.025, 0.085)  # [m] bounds of an object's height
REACH = 0.09  # [m] largest horizontal distance of a point of an object from its centre
STEEPEST = np.deg2rad(26.0)  # [rad] largest angle between finger and surface normal
OFF = 0.02  # [m] largest distance between grasp and centre, horizontally

HAND = panda_fingers(GripperConfig())  # fingers of the table
BESIDE = 0.012  # [m] by which the fingers open wider than the widest object between them
BELOW = 0.0013  # [m] margin below the fingertips
BROADER = 0.00125  # [m] margin on each side of a finger's breadth
LOWEST = 0.013  # [m] smallest height of the TCP above the floor
TURNS = np.arange(-12, 12) * np.pi / 24  # [rad] yaws that are tried
SHIFTS = np.arange(-4, 5) * 0.005  # [m] shifts along the fingers' breadth that are tried


@dataclass(frozen=True)
class Lying:
    """A graspable object at rest on a floor.

    Attributes:
        name: Number of the object in random_urdfs, three digits.
        height: Height of the object's centre above the floor, [m].
        quat_xyzw: Orientation of the object at yaw 0.
    """

    name: str
    height: float
    quat_xyzw: tuple[float, float, float, float]

    @property
    def urdf(self) -> Path:
        """URDF file of the object."""
        return FOLDER / self.name / f"{self.name}.urdf"


@dataclass(frozen=True)
class Grasp:
    """Pose in which the gripper closes on an object.

    Attributes:
        xyz: TCP position in base, (x, y, z), [m].
        theta: Yaw of the gripper, [rad].
        top: Height of the object's top, base z, [m]. A gripper that moves over the object must clear it.
        width: Width of the object between the fingers, [m].
        angle: Larger of the two fingers' angles to the surface normals, [rad].
        lever: Horizontal distance between the TCP and the object's centre, [m].
    """

    xyz: tuple[float, float, float]
    theta: float
    top: float
    width: float
    angle: float
    lever: float

    @property
    def cost(self) -> float:
        """Cost of the grasp, by which grasps are sorted: 1 cm of lever arm costs as much as 6 degrees of angle."""
        return self.angle + 10.0 * self.lever


@cache
def objects() -> tuple[Lying, ...]:
    """Return the graspable objects, sorted by name."""
    with TABLE.open(newline="") as file:
        return tuple(
            Lying(name, float(height), (float(x), float(y), float(z), float(w)))
            for name, height, x, y, z, w in list(csv.reader(file))[1:]
        )


@cache
def split(part: str) -> tuple[Lying, ...]:
    """Return the objects of a part: ``train`` (80 % of the objects) or ``test`` (the others).

    A fixed random permutation of all graspable objects is cut in two. The objects of a part are sorted by name.
    """
    order = np.random.default_rng(0).permutation(len(objects()))
    cut = round(0.8 * len(order))
    chosen = order[:cut] if part == "train" else order[cut:]
    return tuple(objects()[index] for index in np.sort(chosen))


@cache
def surface(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points spread over an object's surface, (N, 3), [m], and the outward unit normals at them, (N, 3).

    Both are in the axes of the object's file.

    Args:
        name: Number of the object in random_urdfs, three digits.
    """
    words = [line.split() for line in (FOLDER / name / f"{name}.obj").read_text().splitlines()]
    vertices = SCALE * np.array([word[1:4] for word in words if word[:1] == ["v"]], np.float64)
    corners = np.array([[w.split("/")[0] for w in word[1:4]] for word in words if word[:1] == ["f"]], np.int64) - 1
    a, b, c = np.moveaxis(vertices[corners], 1, 0)
    normals = np.cross(b - a, c - a)
    sizes = np.sqrt(sum_of_products(normals, normals))[:, None]
    normals = np.divide(normals, sizes, out=np.zeros_like(normals), where=sizes > 0)
    parts = [(i / 6, j / 6) for i in range(7) for j in range(7 - i)]
    points = np.concatenate([a + i * (b - a) + j * (c - a) for i, j in parts])
    return points, np.tile(normals, (len(parts), 1))


def rotation(quat_xyzw: NDArray[np.float64] | tuple[float, ...]) -> NDArray[np.float64]:
    """Return the rotation matrix of a quaternion, (3, 3)."""
    return np.array(pybullet.getMatrixFromQuaternion(quat_xyzw)).reshape(3, 3)


def grasps(
    name: str, position: NDArray[np.float64], quat_xyzw: NDArray[np.float64], floor: float, fingers: Fingers = HAND
) -> list[Grasp]:
    """Find the grasps by which an object can be grasped from above.

    Args:
        name: Number of the object in random_urdfs, three digits.
        position: Centre of the object in base, (3,), [m].
        quat_xyzw: Orientation of the object in base.
        floor: Height of the floor on which the object lies, base z, [m].
        fingers: Fingers that grasp the object.

    Returns:
        Grasps in base, sorted by `Grasp.cost`, the best first. The list is empty if the object has none.
    """
    points, normals = (product(part, rotation(quat_xyzw).T) for part in surface(name))
    points = points + position
    top = float(points[:, 2].max())
    z = max(floor + LOWEST, top - fingers.palm)
    between = points[:, 2] > z - (fingers.tip + BELOW)  # points that the fingers can touch
    points, normals = points[between] - position, normals[between]
    found = []
    for theta in TURNS:
        along, across = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
        u, v = product(points[:, :2], along), product(points[:, :2], across)
        slope = product(normals[:, :2], across)
        for shift in SHIFTS:
            inside = np.abs(u - shift) < 0.5 * fingers.breadth + BROADER
            if not inside.any():
                continue
            ends, facing = v[inside], slope[inside]
            low, high = float(ends.min()), float(ends.max())
            width = high - low
            # Normals of the faces that face the finger and are within 2 mm of the point that it first touches.
            right = facing[(ends > high - 0.002) & (facing > 0.0)]
            left = -facing[(ends < low + 0.002) & (facing < 0.0)]
            if width > 2.0 * fingers.stroke - BESIDE or not len(right) or not len(left):
                continue
            angle = math.acos(min(1.0, right.mean(), left.mean()))
            middle = 0.5 * (low + high)
            x, y = position[:2] + shift * along + middle * across
            found.append(
                Grasp((float(x), float(y), z), float(theta), top, width, angle, float(np.hypot(shift, middle)))
            )
    return sorted(found, key=lambda grasp: grasp.cost)


def lie_down(name: str) -> Lying | None:
    """Put an object down in an empty world, in the orientation of its file, and return how it comes to rest.

    The function returns None if the object does not come to rest within 3 s, or rolls 5 cm or further.
    """
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=0.002, deterministicOverlappingPairs=1, physicsClientId=client)
        ground = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(0.5, 0.5, 0.05), physicsClientId=client)
        table = pybullet.createMultiBody(0.0, ground, -1, (0.0, 0.0, -0.05), physicsClientId=client)
        pybullet.changeDynamics(table, -1, lateralFriction=0.5, physicsClientId=client)
        low = float(surface(name)[0][:, 2].min())
        body = pybullet.loadURDF(str(FOLDER / name / f"{name}.urdf"), (0.0, 0.0, 0.001 - low), physicsClientId=client)
        pybullet.changeDynamics(body, -1, mass=0.15, lateralFriction=0.6, physicsClientId=client)
        still = 0
        for _ in range(1500):
            pybullet.stepSimulation(physicsClientId=client)
            linear, angular = pybullet.getBaseVelocity(body, physicsClientId=client)
            still = still + 1 if length(linear) < 0.01 and length(angular) < 0.1 else 0
            if still == 250:
                (x, y, z), quat = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
                return Lying(name, round(z, 5), tuple(round(q, 5) for q in quat)) if np.hypot(x, y) < 0.05 else None
        return None
    finally:
        pybullet.disconnect(client)


def graspable(name: str) -> Lying | None:
    """Return how an object lies, or None if it is not graspable by the rule at the top of this file."""
    lying = lie_down(name)
    if lying is None:
        return None
    points = product(surface(name)[0], rotation(lying.quat_xyzw).T)
    if not HEIGHT[0] <= np.ptp(points[:, 2]) <= HEIGHT[1] or np.hypot(*points[:, :2].T).max() > REACH:
        return None
    found = grasps(name, np.array([0.0, 0.0, lying.height]), np.array(lying.quat_xyzw), 0.0)
    return lying if any(grasp.angle < STEEPEST and grasp.lever < OFF for grasp in found) else None


def main() -> None:
    """Write the table of graspable objects."""
    rows = [lying for index in range(COUNT) if (lying := graspable(f"{index:03d}"))]
    with TABLE.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "height", "x", "y", "z", "w"])
        writer.writerows([lying.name, lying.height, *lying.quat_xyzw] for lying in rows)
    print(f"{len(rows)} of {COUNT} objects are graspable")


if __name__ == "__main__":
    main()
