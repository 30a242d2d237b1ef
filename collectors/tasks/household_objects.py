"""Which objects of `pybullet_data`'s random_urdfs stand for household objects, how they lie, and where to grasp them.

    .venv/bin/python -m collectors.tasks.household_objects      # rewrites household_objects.csv

random_urdfs are 1000 procedural blobs, convex pieces in an OBJ file each. An object is graspable if, lying as it comes
to rest when it is put down as in its file,

- it comes to rest within 3 s, without rolling further than 5 cm,
- it is 25 to 85 mm high and reaches at most 90 mm from its centre (it must fit the bin and the gripper),
- it has a grasp: a place where it is at most 68 mm wide between the fingers (they open to 80 mm), and where both
  fingers meet it at less than 26 degrees from its surface normal, not further than
  2 cm from its centre.

The table holds the graspable ones and how they lie, so that a process need not try all 1000.
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

FOLDER = Path(pybullet_data.getDataPath()) / "random_urdfs"
TABLE = Path(__file__).with_suffix(".csv")
COUNT = 1000

SCALE = 0.015  # [m] per unit of the OBJ files, in all their URDFs
HEIGHT = (0.025, 0.085)  # [m]
REACH = 0.09  # [m] from the centre
WIDEST = 0.068  # [m] between the fingers
STEEPEST = np.deg2rad(26.0)  # between finger and surface normal
OFF = 0.02  # [m] between grasp and centre, horizontally

TIP = 0.0085  # [m] from the TCP down to the fingertips, and a little
FINGER = 0.010  # [m] half the breadth of a finger, and a little
PALM = 0.040  # [m] from the TCP up to the palm, less a little
LOWEST = 0.013  # [m] TCP above the floor
TURNS = np.arange(-12, 12) * np.pi / 24  # yaws that are tried
SHIFTS = np.arange(-4, 5) * 0.005  # [m] along the fingers' breadth that are tried


@dataclass(frozen=True)
class Lying:
    """A graspable object as it lies.

    Attributes:
        name: Its number in random_urdfs.
        height: Of its centre above the floor, [m].
        quat_xyzw: Its orientation at yaw 0.
    """

    name: str
    height: float
    quat_xyzw: tuple[float, float, float, float]

    @property
    def urdf(self) -> Path:
        """Its file."""
        return FOLDER / self.name / f"{self.name}.urdf"


@dataclass(frozen=True)
class Grasp:
    """Where the gripper closes.

    Attributes:
        xyz: TCP, in the axes of the points it was found on, [m].
        theta: Yaw of the gripper, [rad].
        top: Height of the object, which a travelling gripper must clear, [m].
        width: Of the object between the fingers, [m].
        angle: Between the fingers and the surface normals, [rad].
        lever: Horizontal distance from the object's centre, [m].
    """

    xyz: tuple[float, float, float]
    theta: float
    top: float
    width: float
    angle: float
    lever: float

    @property
    def cost(self) -> float:
        """The smaller the better: 1 cm of lever arm counts as much as 6 degrees."""
        return self.angle + 10.0 * self.lever


@cache
def objects() -> tuple[Lying, ...]:
    """The graspable objects, by name."""
    with TABLE.open(newline="") as file:
        return tuple(
            Lying(name, float(height), (float(x), float(y), float(z), float(w)))
            for name, height, x, y, z, w in list(csv.reader(file))[1:]
        )


@cache
def split(part: str) -> tuple[Lying, ...]:
    """The objects of ``train`` (80 %) or ``test``: a fixed permutation of all of them, cut."""
    order = np.random.default_rng(0).permutation(len(objects()))
    cut = round(0.8 * len(order))
    chosen = order[:cut] if part == "train" else order[cut:]
    return tuple(objects()[index] for index in np.sort(chosen))


@cache
def surface(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (N, 3) [m] spread over an object's surface, and its outward normals there (N, 3), in its own axes."""
    words = [line.split() for line in (FOLDER / name / f"{name}.obj").read_text().splitlines()]
    vertices = SCALE * np.array([word[1:4] for word in words if word[:1] == ["v"]], np.float64)
    corners = np.array([[w.split("/")[0] for w in word[1:4]] for word in words if word[:1] == ["f"]], np.int64) - 1
    a, b, c = np.moveaxis(vertices[corners], 1, 0)
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, sizes, out=np.zeros_like(normals), where=sizes > 0)
    parts = [(i / 6, j / 6) for i in range(7) for j in range(7 - i)]
    points = np.concatenate([a + i * (b - a) + j * (c - a) for i, j in parts])
    return points, np.tile(normals, (len(parts), 1))


def rotation(quat_xyzw: NDArray[np.float64] | tuple[float, ...]) -> NDArray[np.float64]:
    """The matrix of a quaternion, (3, 3)."""
    return np.array(pybullet.getMatrixFromQuaternion(quat_xyzw)).reshape(3, 3)


def grasps(name: str, position: NDArray[np.float64], quat_xyzw: NDArray[np.float64], floor: float) -> list[Grasp]:
    """Where an object can be grasped from above, best first.

    Args:
        name: The object.
        position: Its centre in base, (3,), [m].
        quat_xyzw: Its orientation.
        floor: Height of what it lies on, [m].

    Returns:
        Grasps in base.
    """
    points, normals = (part @ rotation(quat_xyzw).T for part in surface(name))
    points = points + position
    top = float(points[:, 2].max())
    z = max(floor + LOWEST, top - PALM)
    between = points[:, 2] > z - TIP  # what the fingers can touch
    points, normals = points[between] - position, normals[between]
    found = []
    for theta in TURNS:
        along, across = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
        u, v, slope = points[:, :2] @ along, points[:, :2] @ across, normals[:, :2] @ across
        for shift in SHIFTS:
            inside = np.abs(u - shift) < FINGER
            if not inside.any():
                continue
            ends, facing = v[inside], slope[inside]
            low, high = float(ends.min()), float(ends.max())
            width = high - low
            # Faces that look at the finger, of those within 2 mm of where it first touches.
            right = facing[(ends > high - 0.002) & (facing > 0.0)]
            left = -facing[(ends < low + 0.002) & (facing < 0.0)]
            if width > WIDEST or not len(right) or not len(left):
                continue
            angle = math.acos(min(1.0, right.mean(), left.mean()))
            middle = 0.5 * (low + high)
            x, y = position[:2] + shift * along + middle * across
            found.append(
                Grasp((float(x), float(y), z), float(theta), top, width, angle, float(np.hypot(shift, middle)))
            )
    return sorted(found, key=lambda grasp: grasp.cost)


def lie_down(name: str) -> Lying | None:
    """Put an object down in an empty world as in its file; None if it does not come to rest."""
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
            still = still + 1 if np.linalg.norm(linear) < 0.01 and np.linalg.norm(angular) < 0.1 else 0
            if still == 250:
                (x, y, z), quat = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
                return Lying(name, round(z, 5), tuple(round(q, 5) for q in quat)) if np.hypot(x, y) < 0.05 else None
        return None
    finally:
        pybullet.disconnect(client)


def graspable(name: str) -> Lying | None:
    """How an object lies, if the rule above lets it in."""
    lying = lie_down(name)
    if lying is None:
        return None
    points = surface(name)[0] @ rotation(lying.quat_xyzw).T
    if not HEIGHT[0] <= np.ptp(points[:, 2]) <= HEIGHT[1] or np.hypot(*points[:, :2].T).max() > REACH:
        return None
    found = grasps(name, np.array([0.0, 0.0, lying.height]), np.array(lying.quat_xyzw), 0.0)
    return lying if any(grasp.angle < STEEPEST and grasp.lever < OFF for grasp in found) else None


def main() -> None:
    """Write the table."""
    rows = [lying for index in range(COUNT) if (lying := graspable(f"{index:03d}"))]
    with TABLE.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "height", "x", "y", "z", "w"])
        writer.writerows([lying.name, lying.height, *lying.quat_xyzw] for lying in rows)
    print(f"{len(rows)} of {COUNT} objects are graspable")


if __name__ == "__main__":
    main()
