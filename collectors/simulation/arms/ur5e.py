"""The Universal Robots UR5e with a parallel gripper like the Robotiq 2F-85, made of cylinders and boxes.

Source of lengths, masses and centres of mass: Universal Robots, "DH Parameters for calculations of kinematics and
dynamics" (universal-robots.com, articles). The article says that the moments of inertia of a UR5e are negligible and
gives none: those here are of uniform cylinders of about the links' size. Radii and lengths of the cylinders that are
drawn are our estimate from pictures of the arm.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.arms.servo import ServoConfig
from collectors.simulation.arms.torque_arm import Model, TorqueArm, TorqueArmConfig
from collectors.simulation.bounds import Vector3
from collectors.simulation.grippers import robotiq_2f85
from collectors.simulation.grippers.gripper import Fingers
from collectors.simulation.grippers.parallel import GripperConfig, ParallelGripper
from collectors.simulation.grippers.robotiq_2f85 import Robotiq2F85Config, robotiq_fingers
from collectors.simulation.urdf import QUARTER, Solid, UrdfCylinder, joint, link


@dataclass(frozen=True)
class Link:
    """A link of the arm by its row in the table of Denavit-Hartenberg parameters, in the standard convention.

    The frame of the link has the axis of its own joint as z. The next joint's frame is at (a, 0, d), rotated about x.

    Attributes:
        name: Name of the link.
        a: Length along x, [m].
        d: Length along z, [m].
        quarters: Turn about x, in quarters of a turn.
        mass: Mass of the link, [kg].
        centre: Centre of mass, (x, y, z), [m], in the next joint's frame.
        solids: Shapes of the link. The first one has the link's moments of inertia.
    """

    name: str
    a: float
    d: float
    quarters: int
    mass: float
    centre: Vector3
    solids: tuple[UrdfCylinder, ...]

    @property
    def mass_centre(self) -> Vector3:
        """Centre of mass in the link's own frame, (x, y, z), [m]."""
        x, y, z = self.centre
        turned = {0: (y, z), 1: (-z, y), -1: (z, -y)}[self.quarters]
        return self.a + x, turned[0], self.d + turned[1]


LINKS = (
    Link("shoulder", 0.0, 0.1625, 1, 3.761, (0.0, -0.02561, 0.00193), (
        UrdfCylinder(0.06, 0.13, "z", (0.0, 0.0, 0.155)), UrdfCylinder(0.055, 0.07, "y", (0.0, -0.045, 0.1625)))),
    Link("upper_arm", -0.425, 0.0, 0, 8.058, (0.2125, 0.0, 0.11336), (
        UrdfCylinder(0.05, 0.425, "x", (-0.2125, 0.0, 0.138)), UrdfCylinder(0.06, 0.12, "z", (0.0, 0.0, 0.138)),
        UrdfCylinder(0.055, 0.11, "z", (-0.425, 0.0, 0.13)))),
    Link("forearm", -0.3922, 0.0, 0, 2.846, (0.15, 0.0, 0.0265), (
        UrdfCylinder(0.042, 0.3922, "x", (-0.1961, 0.0, 0.007)), UrdfCylinder(0.055, 0.1, "z", (0.0, 0.0, 0.02)),
        UrdfCylinder(0.042, 0.09, "z", (-0.3922, 0.0, 0.015)))),
    Link("wrist_1", 0.0, 0.1333, 1, 1.37, (0.0, -0.0018, 0.01634), (
        UrdfCylinder(0.042, 0.11, "z", (0.0, 0.0, 0.115)), UrdfCylinder(0.04, 0.05, "y", (0.0, -0.03, 0.1333)))),
    Link("wrist_2", 0.0, 0.0997, -1, 1.3, (0.0, 0.0018, 0.01634), (
        UrdfCylinder(0.042, 0.09, "z", (0.0, 0.0, 0.095)), UrdfCylinder(0.04, 0.05, "y", (0.0, 0.03, 0.0997)))),
    Link("wrist_3", 0.0, 0.0996, 0, 0.365, (0.0, 0.0, -0.001159), (
        UrdfCylinder(0.0375, 0.045, "z", (0.0, 0.0, 0.0771)),)),
)  # fmt: skip
BASE = UrdfCylinder(0.075, 0.09, "z", (0.0, 0.0, 0.045))
BASE_MASS = 4.0  # [kg], of no effect because the base is fixed
SILVER: Vector3 = (0.72, 0.74, 0.76)
# About the joint angles at home, [rad], with the elbow up. Of the eight solutions of the inverse kinematics, this one
# and its mirror image keep the elbow high and away from singular postures in the whole workspace: the smallest singular
# value of the Jacobian, in m and rad, is at least 0.12.
POSTURE = (2.90, -1.42, 1.75, -1.90, -QUARTER, -1.82)


@dataclass(frozen=True)
class UR5eConfig(TorqueArmConfig):
    """Configuration of the UR5e: its surface, its control and its gripper.

    Attributes:
        name: Name of the robot.
        servo: Gains of the arm's inner control loop. The arm has no joint to spare, and so no posture to return to.
        gripper: Configuration of the gripper's drive.
    """

    name: Literal["ur5e_sim"] = "ur5e_sim"
    servo: ServoConfig = field(default_factory=lambda: ServoConfig(posture_rate=0.0))
    gripper: Robotiq2F85Config = field(default_factory=Robotiq2F85Config)

    @property
    def fingers(self) -> Fingers:
        """Shape and travel of the gripper's fingers."""
        return robotiq_fingers(self.gripper)

    def place(self, client: int, dt: float, home: NDArray[np.float64]) -> TorqueArm:
        """Load the UR5e and place it at home, with the gripper open and pointing down with yaw 0.

        Args:
            client: PyBullet client id of the world.
            dt: Time of a physics step, [s].
            home: TCP position in base, (3,), [m].
        """
        model = Model(
            urdf_text(self.gripper),
            inertia_from_urdf=True,
            posture=POSTURE,
            sensor=robotiq_2f85.BODY,
            fingers=(robotiq_2f85.LEFT, robotiq_2f85.RIGHT),
            finger_depth=robotiq_2f85.FINGER_DEPTH,
            tcp=robotiq_2f85.TCP,
            tcp_depth=robotiq_2f85.TCP_DEPTH,
        )
        return TorqueArm(self, model, ParallelGripper(self.gripper, dt), client, dt, home)


def urdf_text(gripper: GripperConfig) -> str:
    """Return the URDF of the arm with its gripper.

    Args:
        gripper: Configuration of the gripper's drive.
    """
    base: list[Solid] = [BASE]
    text = link("base", BASE_MASS, BASE.centre, BASE.inertia(BASE_MASS), base, SILVER)
    parent, at, turn = "base", (0.0, 0.0, 0.0), 0.0
    for one in LINKS:
        text += link(one.name, one.mass, one.mass_centre, one.solids[0].inertia(one.mass), one.solids, SILVER)
        text += joint("revolute", parent, one.name, at, (turn, 0.0, 0.0))
        parent, at, turn = one.name, (one.a, 0.0, one.d), one.quarters * QUARTER
    text += robotiq_2f85.urdf_text(parent, LINKS[-1].d, gripper.stroke)
    return f'<robot name="ur5e">\n{text}</robot>\n'
