"""The Franka Emika Panda with its hand: loading, reading, and moving the tool centre point (TCP)."""

import math
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
from numpy.typing import NDArray

ARM = (0, 1, 2, 3, 4, 5, 6)
SENSOR_JOINT = 8  # panda_hand_joint, fixed
LEFT_FINGER, RIGHT_FINGER = 9, 10
TCP_LINK = 11  # panda_grasptarget, 0.105 m below the sensor origin
MOVING = (*ARM, LEFT_FINGER, RIGHT_FINGER)
DISTAL = (SENSOR_JOINT, LEFT_FINGER, RIGHT_FINGER)  # the links whose weight hangs on the sensor

# Elbow-up posture in which Franka's own examples start; it only decides which way the elbow points.
POSTURE = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)


@dataclass(frozen=True)
class PandaConfig:
    """Numbers of the arm's inner loop and of the hand.

    Attributes:
        tracking_gain: Fraction of the pose error that is removed in each physics step.
        ik_damping: Damping of the differential inverse kinematics, [m] and [rad].
        posture_rate: How fast the elbow drifts back to its posture without moving the hand, [1/s].
        arm_effort: Largest torque of an arm joint, [N m]. The motors are ideal on purpose: 25 mm in 50 ms takes up to
            58 m/s^2, while a real Panda (13 m/s^2, 87 and 12 N m) would still be on its way when the next action comes.
        finger_speed: Speed of a finger, [m/s] (limit in panda.urdf: 0.2).
        finger_force: Largest force of a finger, [N] (effort limit in panda.urdf: 20).
        finger_stroke: Travel of a finger from closed to open, [m] (panda.urdf).
        finger_friction: Coulomb friction of a finger; PyBullet multiplies it by the object's.
        full_meshes: Draw the whole arm with its fine visual meshes (5 to 10 times slower).
    """

    tracking_gain: float = 0.2
    ik_damping: float = 1e-3
    posture_rate: float = 2.0
    arm_effort: float = 1000.0
    finger_speed: float = 0.2
    finger_force: float = 20.0
    finger_stroke: float = 0.04
    finger_friction: float = 1.0
    full_meshes: bool = False


def urdf_text(full_meshes: bool) -> str:
    """The Panda's URDF with absolute mesh paths, its arm drawn with the coarse collision meshes.

    The software renderer's cost is the number of triangles: 101,735 in the fine meshes. Hand and fingers keep theirs
    (8,326), everything else is drawn with its collision hull (3,208).
    """
    folder = Path(pybullet_data.getDataPath()) / "franka_panda"
    text = (folder / "panda.urdf").read_text()
    if not full_meshes:
        text = re.sub(r"meshes/visual/(link\d)", r"meshes/collision/\1", text)
    return text.replace("package://", f"{folder}/")


def down_quat(theta: float) -> tuple[float, float, float, float]:
    """Orientation of a hand that points straight down with yaw theta: Rz(theta) Rx(pi), as quat_xyzw."""
    return (math.cos(0.5 * theta), math.sin(0.5 * theta), 0.0, 0.0)


def rotation_error(theta: float, quat: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Small rotation vector in base axes that turns `quat` (xyzw) into `down_quat(theta)`, [rad].

    Twice the vector part of the quaternion product q_desired q*; exact to third order.
    """
    c, s = math.cos(0.5 * theta), math.sin(0.5 * theta)
    x, y, z, w = quat
    sign = 2.0 if c * x + s * y >= 0.0 else -2.0
    return (sign * (w * c - s * z), sign * (w * s + c * z), sign * (s * x - c * y))


class Panda:
    """One Panda in one PyBullet world, its base at the origin.

    Args of every motion are base axes, [m] and [rad]. After `read` the attributes describe the current state:
    `position` (3,) and `quat` (xyzw) of the TCP, `joints` (9,) (arm [rad], left and right finger [m]), `velocity` (3,)
    of the TCP [m/s], and `reaction` (6,), the raw joint reaction at the sensor.
    """

    def __init__(self, config: PandaConfig, client: int, dt: float) -> None:
        """Load the robot.

        Args:
            config: Gains and limits.
            client: PyBullet client id.
            dt: Physics step, [s].
        """
        self._config = config
        self._client = client
        self._dt = dt
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "panda.urdf"
            path.write_text(urdf_text(config.full_meshes))
            self.body: int = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        for link in (-1, *range(TCP_LINK + 1)):  # no air drag: it would show in the wrist readings
            pybullet.changeDynamics(
                self.body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client
            )
        for link in (LEFT_FINGER, RIGHT_FINGER):
            pybullet.changeDynamics(self.body, link, lateralFriction=config.finger_friction, physicsClientId=client)
        pybullet.enableJointForceTorqueSensor(self.body, SENSOR_JOINT, True, physicsClientId=client)
        self.hand_mass: float = sum(
            pybullet.getDynamicsInfo(self.body, link, physicsClientId=client)[0] for link in DISTAL
        )
        self._posture = np.array(POSTURE)
        self._damping = config.ik_damping**2 * np.eye(6)
        self._zeros = [0.0] * len(MOVING)
        self._gains = [1.0] * len(MOVING)
        self._forces = [config.arm_effort] * len(ARM) + [config.finger_force] * 2
        self._finger_target = config.finger_stroke
        self.joints = np.array([*POSTURE, config.finger_stroke, config.finger_stroke])
        self.velocity = np.zeros(3)
        self.reaction = np.zeros(6)
        self.position = np.zeros(3)
        self.quat = down_quat(0.0)
        self._jacobian = np.zeros((6, 7))

    def place(self, position: NDArray[np.float64], theta: float) -> None:
        """Put the arm at a TCP pose at once, gripper open, by Newton steps on the kinematics."""
        for _ in range(100):
            for joint, value in zip(MOVING, self.joints, strict=True):
                pybullet.resetJointState(self.body, joint, value, physicsClientId=self._client)
            self.read(forward_kinematics=True)
            error = np.array([*(position - self.position), *rotation_error(theta, self.quat)])
            self.joints[:7] += self._joint_step(error, 0.0)
        self._finger_target = self._config.finger_stroke

    def read(self, forward_kinematics: bool = False) -> None:
        """Read joints, TCP and wrist from the simulator.

        Args:
            forward_kinematics: Recompute the link poses; needed only after joints were set without a physics step.
        """
        states = pybullet.getJointStates(self.body, (*MOVING, SENSOR_JOINT), physicsClientId=self._client)
        joints = [state[0] for state in states[:9]]
        self.joints = np.array(joints)
        self.reaction = np.array(states[9][2])
        link = pybullet.getLinkState(
            self.body, TCP_LINK, computeForwardKinematics=forward_kinematics, physicsClientId=self._client
        )
        self.position, self.quat = np.array(link[4]), link[5]
        linear, angular = pybullet.calculateJacobian(
            self.body, TCP_LINK, (0.0, 0.0, 0.0), joints, self._zeros, self._zeros, physicsClientId=self._client
        )
        self._jacobian = np.array(linear + angular)[:, :7]
        self.velocity = self._jacobian[:3] @ [state[1] for state in states[:7]]

    @property
    def theta(self) -> float:
        """Yaw of the hand, [rad], in (-pi, pi]; 0 when the fingers open along base y."""
        return math.atan2(2.0 * self.quat[0] * self.quat[1], self.quat[0] ** 2 - self.quat[1] ** 2)

    @property
    def opening(self) -> float:
        """Gripper opening, 0 closed to 1 open."""
        return float(self.joints[7] + self.joints[8]) / (2.0 * self._config.finger_stroke)

    def command(
        self, position: NDArray[np.float64], theta: float, velocity: NDArray[np.float64], spin: float, opening: float
    ) -> None:
        """Set the motors for the next physics step, so that the TCP goes where it should be, at the given velocity.

        Differential inverse kinematics (Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", eq. 3.54
        and 3.70): joint step = J# (feed-forward + gain * pose error) + null-space motion to the elbow posture, with
        the damped pseudo-inverse J# = J^T (J J^T + lambda^2 I)^-1.

        Args:
            position: Where the TCP should be now, (3,), [m].
            theta: Yaw the hand should have now, [rad].
            velocity: Velocity to the next target, (3,), [m/s].
            spin: Yaw rate to the next target, [rad/s].
            opening: Wanted gripper opening, 0 to 1; the fingers go there at their own speed.
        """
        gain = self._config.tracking_gain
        error = np.empty(6)
        error[:3] = velocity * self._dt + gain * (position - self.position)
        error[3:] = gain * np.array(rotation_error(theta, self.quat))
        error[5] += spin * self._dt
        arm = self.joints[:7] + self._joint_step(error, self._config.posture_rate * self._dt)
        reach = self._config.finger_speed * self._dt
        goal = opening * self._config.finger_stroke
        self._finger_target += min(max(goal - self._finger_target, -reach), reach)
        pybullet.setJointMotorControlArray(
            self.body,
            MOVING,
            pybullet.POSITION_CONTROL,
            targetPositions=[*arm.tolist(), self._finger_target, self._finger_target],
            targetVelocities=self._zeros,
            positionGains=self._gains,
            velocityGains=self._gains,
            forces=self._forces,
            physicsClientId=self._client,
        )

    def _joint_step(self, error: NDArray[np.float64], posture_fraction: float) -> NDArray[np.float64]:
        """Joint motion (7,) for a small TCP motion `error` (6,), pulling the elbow by `posture_fraction`."""
        J = self._jacobian
        pull = posture_fraction * (self._posture - self.joints[:7])
        step: NDArray[np.float64] = pull + J.T @ np.linalg.solve(J @ J.T + self._damping, error - J @ pull)
        return step
