"""A small cabinet with one drawer, made of boxes, and the base class of the two tasks with the drawer."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from collectors.recording.loop import OBJECT
from collectors.simulation.bodies import Box, Vector3, quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.simulation.world import World
from collectors.tasks.gripper import Gripper, Moves, nearest_turn
from collectors.tasks.task import Task

TRAVEL = 0.16  # [m] travel of the drawer from closed to its stop
FRICTION = 4.0  # [N] dry friction of the runners
DAMPING = 15.0  # [N s/m] damping of the runners
MASS = 0.6  # [kg] mass of the drawer
HEIGHT = 0.08  # [m] height of the cabinet: below the palm of a gripper whose fingers are behind the handle
GAP = 0.04  # [m] between the drawer's front and the handle; a finger is 0.021 m thick
BAR = 0.012  # [m] thickness of the handle along the travel
HANDLE_Z = 0.058  # [m] height of the handle's middle
OVER = HEIGHT + 0.05  # [m] height of the TCP of a gripper that moves over the cabinet
CABINET: Vector3 = (0.80, 0.76, 0.68)
HANDLE: Vector3 = (0.15, 0.15, 0.18)


@dataclass(frozen=True)
class Scene:
    """Scene that is drawn for an episode, in the ranges of the reference benchmark.

    Attributes:
        xy: Middle of the closed drawer's front in base, (x, y), [m]. The handle is 5 to 10 cm behind the middle of the
            workspace, seen along the travel, and up to 10 cm beside that middle.
        yaw: Direction in which the drawer opens, [rad], drawn from the full circle.
    """

    xy: tuple[float, float]
    yaw: float


class DrawerTask(Task):
    """Base of the tasks with a cabinet that is fixed to the table and has a drawer.

    The drawer's frame has its origin on the table below the middle of the drawer's front, and its x axis in the
    direction in which the drawer opens. Moving the drawer takes 4 N, and 15 N more per m/s: 10 N at 0.4 m/s.
    """

    opened: ClassVar[float]
    """Opening of the drawer when the task begins, [m]."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Draw a scene in which the handle stays in the workspace on its whole way."""
        yaw = rng.uniform(-np.pi, np.pi)
        along, across = -rng.uniform(0.05, 0.10) - GAP, rng.uniform(-0.1, 0.1)
        x, y = world.workspace[:2].mean(axis=1) + _turned(along, across, yaw)
        return Scene(xy=(float(x), float(y)), yaw=float(yaw))

    def __init__(self, world: World, scene: Scene) -> None:
        """Fix the cabinet to the table, with its drawer open by `opened`."""
        self.world, self.scene = world, scene
        self.body = world.bodies.add_urdf(urdf_text(self.color), (*scene.xy, 0.0), quat_from_yaw(scene.yaw), fixed=True)
        client = world.client
        for link in (-1, 0):
            world.bodies.set_dynamics(self.body, link, lateralFriction=0.4)
        world.bodies.set_dynamics(self.body, 0, jointDamping=DAMPING, linearDamping=0.0, angularDamping=0.0)
        # PyBullet's default motor, commanded to stand still with a limited force, acts as dry friction.
        pybullet.setJointMotorControl2(
            self.body, 0, pybullet.VELOCITY_CONTROL, targetVelocity=0.0, force=FRICTION, physicsClientId=client
        )
        pybullet.resetJointState(self.body, 0, self.opened, physicsClientId=client)

    @property
    def opening(self) -> float:
        """Present opening of the drawer, [m]."""
        position: float = pybullet.getJointState(self.body, 0, physicsClientId=self.world.client)[0]
        return position

    def at(self, along: float, across: float) -> tuple[float, float]:
        """Return the present position in base, (x, y), [m], of a point in the drawer's frame.

        Args:
            along: Position of the point along the direction in which the drawer opens, [m].
            across: Position of the point across that direction, [m].
        """
        x, y = np.array(self.scene.xy) + _turned(self.opening + along, across, self.scene.yaw)
        return float(x), float(y)

    def gripper_at(self) -> tuple[float, float, float]:
        """Return the present TCP position in the drawer's frame: along the opening, across it and up, [m]."""
        x, y, z = self.world.tcp[:3]
        along, across = _turned(x - self.scene.xy[0], y - self.scene.xy[1], -self.scene.yaw)
        return float(along) - self.opening, float(across), float(z)

    def reach(self, gripper: Gripper, along: float, across: float, z: float) -> Moves:
        """Move over a point of the drawer's frame, and then down to the point.

        The fingers are closed and side by side across the travel of the drawer.

        Args:
            gripper: Gripper that makes the actions.
            along: Distance of the point from the drawer's front, in the direction in which the drawer opens, [m].
            across: Distance of the point from the middle of the front, across that direction, [m].
            z: Height to which the TCP goes down, base z, [m].

        Yields:
            Actions. The movement ends early if the fingers meet something on their way down.
        """
        gripper.opening = 0.0
        theta = nearest_turn(self.scene.yaw, np.pi)
        yield from gripper.go(z=max(self.world.target[2], OVER))
        yield from gripper.go(*self.at(along, across), OVER, theta, loose=True)
        yield from gripper.go(*self.at(along, across), OVER - 0.015, theta)
        yield from gripper.go(z=z, exact=True, until=self._blocked)

    def _blocked(self) -> bool:
        """Return whether the gripper is held up by more than 8 mm, which takes 20 N, and so stands on something."""
        return bool(self.world.tcp[2] - self.world.reference[2] > 0.008)

    def state(self) -> Mapping[str, np.ndarray]:
        """Return the drawer's pose in base, (7,): position [m], quat_xyzw, and its opening as ``drawer``, (1,), [m]."""
        pose = np.array([*self.at(0.0, 0.0), 0.0, *quat_from_yaw(self.scene.yaw)])
        return {OBJECT: pose, "drawer": np.array([self.opening])}


def urdf_text(color: Vector3) -> str:
    """Return the URDF of the cabinet with its drawer, 24 cm wide, 21 cm deep and `HEIGHT` high.

    Args:
        color: RGB of the drawer, 0 to 1.
    """
    side, middle = 0.5 * (HEIGHT - 0.01), 0.5 * HEIGHT
    cabinet = [
        Box((0.1, 0.12, 0.005), (-0.112, 0.0, HEIGHT - 0.005), color=CABINET),
        Box((0.1, 0.005, side), (-0.112, 0.115, side), color=CABINET),
        Box((0.1, 0.005, side), (-0.112, -0.115, side), color=CABINET),
        Box((0.005, 0.11, side), (-0.207, 0.0, side), color=CABINET),
    ]
    bar = GAP + 0.5 * BAR
    drawer = [
        Box((0.006, 0.12, middle - 0.002), (-0.006, 0.0, middle), color=color),
        Box((0.094, 0.1, 0.003), (-0.106, 0.0, 0.008), color=color),
        Box((0.094, 0.003, 0.02), (-0.106, 0.097, 0.031), color=color),
        Box((0.094, 0.003, 0.02), (-0.106, -0.097, 0.031), color=color),
        Box((0.003, 0.094, 0.02), (-0.197, 0.0, 0.031), color=color),
        Box((0.5 * BAR, 0.07, 0.01), (bar, 0.0, HANDLE_Z), color=HANDLE),
        Box((0.5 * GAP, 0.006, 0.01), (0.5 * GAP, 0.064, HANDLE_Z), color=HANDLE),
        Box((0.5 * GAP, 0.006, 0.01), (0.5 * GAP, -0.064, HANDLE_Z), color=HANDLE),
    ]
    return f"""<robot name="cabinet">
        {_link("cabinet", 0.0, cabinet)}
        {_link("drawer", MASS, drawer)}
        <joint name="runner" type="prismatic">
            <parent link="cabinet"/><child link="drawer"/><axis xyz="1 0 0"/>
            <limit lower="0" upper="{TRAVEL}" effort="100" velocity="10"/>
        </joint>
    </robot>"""


def _link(name: str, mass: float, boxes: list[Box]) -> str:
    """Return a URDF link made of boxes.

    PyBullet computes the link's inertia from the shapes. The inertia does not matter to a sliding joint.
    """
    parts = []
    for box in boxes:
        x, y, z = box.position
        size = " ".join(str(2.0 * half) for half in box.half_extents)
        shape = f'<origin xyz="{x} {y} {z}"/><geometry><box size="{size}"/></geometry>'
        rgba = " ".join(str(value) for value in (*box.color, 1.0))
        material = f'<material name="{rgba}"><color rgba="{rgba}"/></material>'
        parts.append(f"<visual>{shape}{material}</visual><collision>{shape}</collision>")
    inertial = f'<inertial><mass value="{mass}"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
    return f'<link name="{name}">{inertial}{"".join(parts)}</link>'


def _turned(x: float, y: float, yaw: float) -> np.ndarray:
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([cos * x - sin * y, sin * x + cos * y])
