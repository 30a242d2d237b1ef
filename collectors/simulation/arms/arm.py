"""The contract of a simulated robot: an arm that carries a gripper, and the configuration that places it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.bounds import Vector3
from collectors.simulation.grippers.gripper import Fingers, Gripper


class Arm(Protocol):
    """Protocol of an arm with a gripper in one PyBullet world, with its base at the origin.

    The TCP is between the fingertips. At yaw 0 the gripper points down, and the fingers open along base y, the left
    finger at -y. `World` copies the arm by `copy.deepcopy` when it is reset, and restores the state of PyBullet itself.
    The attributes below `gripper` are the state after the latest physics step.

    Attributes:
        body: Body id of the robot, arm and gripper.
        sensor_joint: Index of the fixed joint between flange and gripper, where the wrist sensor is.
        finger_links: Indices of the left and the right finger's links.
        gripper: Gripper that the arm carries.
        gripper_mass: Mass of all that the sensor carries, [kg].
        joints: Angles of the arm's joints, [rad], then positions of the left and the right finger, [m].
        position: TCP position in base, (x, y, z), [m].
        quat: TCP orientation in base, quat_xyzw.
        gripper_velocity: Velocity of the centre of mass of all that the sensor carries, (x, y, z), [m/s], base axes.
        reaction: Raw joint reaction at the sensor, six numbers, [N] and [N m], base axes (see
            `collectors.simulation.wrist_sensor`).
    """

    body: int
    sensor_joint: int
    finger_links: tuple[int, int]
    gripper: Gripper
    gripper_mass: float
    joints: tuple[float, ...]
    position: Vector3
    quat: tuple[float, float, float, float]
    gripper_velocity: Vector3
    reaction: tuple[float, ...]

    @property
    def theta(self) -> float:
        """Yaw of the gripper, [rad], in (-pi, pi]. It is 0 when the fingers open along base y."""

    @property
    def opening(self) -> float:
        """Measured gripper opening, 0 closed to 1 open."""

    def drive(self, pose: Sequence[float], motion: Sequence[float], opening: float) -> None:
        """Set the motors for the next physics step.

        Args:
            pose: Wanted TCP pose now, in base, (x, y, z, theta), [m] and [rad].
            motion: Wanted motion of the TCP in this step, base axes, (dx, dy, dz, dtheta), [m] and [rad].
            opening: Wanted gripper opening, 0 closed to 1 open.
        """

    def read(self) -> None:
        """Read the state from the simulator after a physics step."""


class RobotConfig(ABC):
    """Configuration of a simulated robot: the base class of a frozen dataclass for each robot.

    All fields are numbers, names or such dataclasses, so that a stored configuration can be read back. A package adds a
    robot by such a class and an entry point (`collectors.robots`).

    Attributes:
        name: Name of the robot, under which `collectors.robots` finds its class.
    """

    name: str

    @property
    @abstractmethod
    def fingers(self) -> Fingers:
        """Shape and travel of the robot's fingers."""

    @abstractmethod
    def place(self, client: int, dt: float, home: NDArray[np.float64]) -> Arm:
        """Load the robot and place it at home, with the gripper open and pointing down with yaw 0.

        Args:
            client: PyBullet client id of the world.
            dt: Time of a physics step, [s].
            home: TCP position in base, (3,), [m].
        """
