"""A small cabinet with one drawer, made of boxes, and what its two tasks have in common."""

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

TRAVEL = 0.16  # [m] from closed to the stop
FRICTION = 4.0  # [N], dry, of the runners
DAMPING = 15.0  # [N s/m] of the runners
MASS = 0.6  # [kg] of the drawer
HEIGHT = 0.08  # [m] of the cabinet: below the palm of a gripper whose fingers are behind the handle
GAP = 0.04  # [m] between front and handle; a finger is 0.021 m thick
BAR = 0.012  # [m] thickness of the handle along the travel
HANDLE_Z = 0.058  # [m] middle of the handle
OVER = HEIGHT + 0.05  # [m], of the TCP of a gripper that travels
CABINET: Vector3 = (0.80, 0.76, 0.68)
HANDLE: Vector3 = (0.15, 0.15, 0.18)


@dataclass(frozen=True)
class Scene:
    """What is drawn (ranges of the reference benchmark).

    Attributes:
        xy: Middle of the closed drawer's front, [m]: the handle is 5 to 10 cm behind the middle of the workspace, seen
            along the travel, and up to 10 cm beside it.
        yaw: Direction in which the drawer opens, [rad], all round.
    """

    xy: tuple[float, float]
    yaw: float


class DrawerTask(Task):
    """A cabinet that stands fast, and its drawer.

    The drawer's frame has its origin on the table below the middle of the front, and x in the direction in which it
    opens. Moving it takes 4 N, and 15 N more per m/s: 10 N at 0.4 m/s.
    """

    opened: ClassVar[float]
    """How far the drawer is open when the task begins, [m]."""

    scene: Scene

    @classmethod
    def draw(cls, rng: np.random.Generator, world: World) -> Scene:
        """Such that the handle stays in the workspace on its whole way."""
        yaw = rng.uniform(-np.pi, np.pi)
        along, across = -rng.uniform(0.05, 0.10) - GAP, rng.uniform(-0.1, 0.1)
        x, y = world.workspace[:2].mean(axis=1) + _turned(along, across, yaw)
        return Scene(xy=(float(x), float(y)), yaw=float(yaw))

    def __init__(self, world: World, scene: Scene) -> None:
        """Put the cabinet on the table, its drawer `opened`."""
        self.world, self.scene = world, scene
        self.body = world.bodies.add_urdf(urdf_text(self.color), (*scene.xy, 0.0), quat_from_yaw(scene.yaw), fixed=True)
        client = world.client
        for link in (-1, 0):
            world.bodies.set_dynamics(self.body, link, lateralFriction=0.4)
        world.bodies.set_dynamics(self.body, 0, jointDamping=DAMPING, linearDamping=0.0, angularDamping=0.0)
        # PyBullet's default motor, told to stand still with a limited force, is dry friction.
        pybullet.setJointMotorControl2(
            self.body, 0, pybullet.VELOCITY_CONTROL, targetVelocity=0.0, force=FRICTION, physicsClientId=client
        )
        pybullet.resetJointState(self.body, 0, self.opened, physicsClientId=client)

    @property
    def opening(self) -> float:
        """How far the drawer is open, [m]."""
        position: float = pybullet.getJointState(self.body, 0, physicsClientId=self.world.client)[0]
        return position

    def at(self, along: float, across: float) -> tuple[float, float]:
        """Where a point of the drawer is now, given in its own frame: base x, y, [m]."""
        x, y = np.array(self.scene.xy) + _turned(self.opening + along, across, self.scene.yaw)
        return float(x), float(y)

    def gripper_at(self) -> tuple[float, float, float]:
        """Where the TCP is now, in the drawer's frame: along, across, up, [m]."""
        x, y, z = self.world.tcp[:3]
        along, across = _turned(x - self.scene.xy[0], y - self.scene.xy[1], -self.scene.yaw)
        return float(along) - self.opening, float(across), float(z)

    def reach(self, gripper: Gripper, along: float, across: float, z: float) -> Moves:
        """Over a point of the drawer's frame with closed fingers side by side across the travel, then down there.

        Args:
            gripper: The gripper.
            along: Where to, before the front, [m].
            across: Where to, beside its middle, [m].
            z: How low, [m].

        Yields:
            Actions. Ends early if the fingers meet something on their way down.
        """
        gripper.opening = 0.0
        theta = nearest_turn(self.scene.yaw, np.pi)
        yield from gripper.go(z=max(self.world.target[2], OVER))
        yield from gripper.go(*self.at(along, across), OVER, theta, loose=True)
        yield from gripper.go(*self.at(along, across), OVER - 0.015, theta)
        yield from gripper.go(z=z, exact=True, until=self._blocked)

    def _blocked(self) -> bool:
        """Whether the gripper stands on something: it is held up by 8 mm, which takes 20 N."""
        return bool(self.world.tcp[2] - self.world.reference[2] > 0.008)

    def state(self) -> Mapping[str, np.ndarray]:
        """Pose of the drawer's moving part, and ``drawer``: how far it is open, (1,), [m]."""
        pose = np.array([*self.at(0.0, 0.0), 0.0, *quat_from_yaw(self.scene.yaw)])
        return {OBJECT: pose, "drawer": np.array([self.opening])}


def urdf_text(color: Vector3) -> str:
    """The URDF of cabinet and drawer, 24 cm wide, 21 cm deep, `HEIGHT` high.

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
    """A link of boxes; its inertia is PyBullet's, from the shapes, and does not matter to a sliding joint."""
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
