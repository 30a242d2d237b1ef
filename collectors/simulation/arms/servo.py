"""Control of the arm by position: from a pose and motion of the tool centre point (TCP) to joint accelerations."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.arms.kinematics import servo_acceleration
from collectors.simulation.bounds import NotNegative, Positive, Share


@dataclass(frozen=True)
class ServoConfig:
    """Gains of the arm's inner control loop.

    Attributes:
        bandwidth: Natural frequency of every joint about its commanded angle, [rad/s].
        damping_ratio: Damping of a joint's motion about its commanded angle, relative to the critical damping.
        correction: Fraction of the TCP's pose error that is added to the joint command in each physics step. It removes
            the deflection of the joints under load and the drift of the differential kinematics.
        ik_damping: Damping of the differential inverse kinematics, [m] and [rad].
        posture_rate: Rate at which the elbow of an arm with more than six joints returns to its posture without moving
            the gripper, [1/s].
    """

    bandwidth: Positive = 60.0
    damping_ratio: NotNegative = 0.7
    correction: Share = 0.05
    ik_damping: Positive = 1e-3
    posture_rate: NotNegative = 2.0


def rotation_error(theta: float, quat: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Return the small rotation vector, base axes, [rad], from a gripper's orientation to pointing down with a yaw.

    The wanted orientation is Rz(theta) Rx(pi), as quat_xyzw (cos theta/2, sin theta/2, 0, 0). The vector is twice the
    vector part of the product wanted * conjugate(quat), which is exact to second order.

    Args:
        theta: Wanted yaw, [rad].
        quat: Present orientation of the gripper in base, quat_xyzw.
    """
    c, s = math.cos(0.5 * theta), math.sin(0.5 * theta)
    x, y, z, w = quat
    sign = 2.0 if c * x + s * y >= 0.0 else -2.0
    return (sign * (w * c - s * z), sign * (w * s + c * z), sign * (s * x - c * y))


class Servo:
    """Controller whose joint commands follow the TCP command, and whose accelerations follow the joint commands.

    The control law is computed-torque control (Siciliano et al. 2009, section 8.5.2): q'' = q_c'' + 2 zeta w (q_c' -
    q') + w^2 (q_c - q). The joints have a finite stiffness on purpose. With PyBullet's position motors, which are
    rigid, a sticking finger meets an infinite stiffness and the admittance loop chatters between the limits of
    friction.
    """

    def __init__(
        self, config: ServoConfig, dt: float, joints: NDArray[np.float64], posture: NDArray[np.float64]
    ) -> None:
        """Start at rest.

        Args:
            config: Gains of the control loop.
            dt: Control period, [s].
            joints: Present angles of the arm's A joints, (A,), [rad].
            posture: Angles to which the joints return as far as this does not move the gripper, (A,), [rad].
        """
        c = config
        self._gains = (c.bandwidth, c.damping_ratio, c.correction, c.ik_damping, c.posture_rate)
        self._dt = dt
        self._joints = joints.copy()
        self._posture = posture
        self._rates = np.zeros(len(joints))

    def acceleration(
        self,
        jacobian: NDArray[np.float64],
        motion: tuple[float, float, float, float, float, float],
        error: tuple[float, float, float, float, float, float],
        joints: tuple[float, ...],
        rates: tuple[float, ...],
    ) -> list[float]:
        """Return the joint accelerations for the next physics step.

        Args:
            jacobian: Geometric Jacobian of the TCP, (6, A), linear rows first, base axes.
            motion: Commanded motion of the TCP in this step, six numbers, [m] and [rad], base axes.
            error: Commanded minus present pose of the TCP, six numbers, [m] and [rad], base axes.
            joints: Present joint angles, [rad], of which the first A are the arm's.
            rates: Present joint rates, [rad/s], of which the first A are the arm's.

        Returns:
            Accelerations of the arm's joints, A numbers, [rad/s^2].
        """
        found: list[float] = servo_acceleration(
            jacobian, motion, error, joints, rates, self._joints, self._rates, self._gains, self._posture, self._dt
        ).tolist()
        return found
