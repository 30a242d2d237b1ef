"""From a pose and velocity of the tool centre point (TCP) to joint accelerations: the position-controlled arm."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Elbow-up posture in which Franka's own examples start; it decides which way the elbow points.
POSTURE = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)


@dataclass(frozen=True)
class ServoConfig:
    """Numbers of the arm's inner loop.

    Attributes:
        bandwidth: Natural frequency of every joint about its commanded angle, [rad/s].
        damping_ratio: Damping of that motion, relative to critical.
        correction: Fraction of the TCP's pose error that is added to the joint command in each physics step: it takes
            out the give of the joints under load and the drift of the differential kinematics.
        ik_damping: Damping of the differential inverse kinematics, [m] and [rad].
        posture_rate: How fast the elbow returns to its posture without moving the hand, [1/s].
    """

    bandwidth: float = 60.0
    damping_ratio: float = 0.7
    correction: float = 0.05
    ik_damping: float = 1e-3
    posture_rate: float = 2.0


def rotation_error(theta: float, quat: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Small rotation vector in base axes that turns a hand at `quat` into one pointing down with yaw `theta`, [rad].

    The wanted orientation is Rz(theta) Rx(pi), as quat_xyzw (cos theta/2, sin theta/2, 0, 0). The vector is twice the
    vector part of the product wanted * conjugate(quat); exact to second order.
    """
    c, s = math.cos(0.5 * theta), math.sin(0.5 * theta)
    x, y, z, w = quat
    sign = 2.0 if c * x + s * y >= 0.0 else -2.0
    return (sign * (w * c - s * z), sign * (w * s + c * z), sign * (s * x - c * y))


def joint_motion(
    jacobian: NDArray[np.float64], motion: NDArray[np.float64], posture: NDArray[np.float64], damping: float
) -> NDArray[np.float64]:
    """Differential inverse kinematics with a wish for the redundant joint.

    dq = J# dx + (I - J# J) dq_posture with the damped pseudo-inverse J# = J^T (J J^T + damping^2 I)^-1.

    Source: Siciliano, Sciavicco, Villani, Oriolo (2009), "Robotics: Modelling, Planning and Control", section 3.5.

    Args:
        jacobian: Geometric Jacobian of the TCP, (6, 7), linear rows first, base axes.
        motion: Small motion of the TCP, (6,), [m] and [rad].
        posture: Joint motion that is done as far as the hand does not notice, (7,), [rad].
        damping: Keeps the step finite near singular postures, [m] and [rad].

    Returns:
        Joint motion, (7,), [rad].
    """
    gram = jacobian @ jacobian.T
    gram.flat[::7] += damping * damping
    step: NDArray[np.float64] = posture + jacobian.T @ np.linalg.solve(gram, motion - jacobian @ posture)
    return step


class Servo:
    """Joint commands that follow the TCP command, and the accelerations that follow the joint commands.

    The law is computed-torque control (Siciliano et al. 2009, section 8.5.2): q'' = q_c'' + 2 zeta w (q_c' - q') +
    w^2 (q_c - q). The joints have a finite stiffness on purpose. With PyBullet's position motors, which are rigid, a
    sticking finger meets an infinite stiffness and the admittance loop chatters between the limits of friction.
    """

    def __init__(self, config: ServoConfig, dt: float, joints: NDArray[np.float64]) -> None:
        """Start at rest.

        Args:
            config: Gains.
            dt: Control period, [s].
            joints: Present joint angles, (7,), [rad].
        """
        self._config = config
        self._dt = dt
        self._joints = joints.tolist()
        self._rate = [0.0] * 7

    def acceleration(
        self,
        jacobian: NDArray[np.float64],
        motion: NDArray[np.float64],
        error: NDArray[np.float64],
        joints: Sequence[float],
        rates: Sequence[float],
    ) -> list[float]:
        """Joint accelerations for the next physics step.

        Args:
            jacobian: Geometric Jacobian of the TCP, (6, 7), base axes.
            motion: Commanded motion of the TCP in this step, (6,), [m] and [rad], base axes.
            error: Commanded minus present pose of the TCP, (6,), [m] and [rad], base axes.
            joints: Present joint angles, seven, [rad].
            rates: Present joint rates, seven, [rad/s].

        Returns:
            Joint accelerations, seven, [rad/s^2].
        """
        c, dt = self._config, self._dt
        return_rate = c.posture_rate * dt
        posture = np.array([return_rate * (p - q) for p, q in zip(POSTURE, joints, strict=True)])
        steps = joint_motion(jacobian, motion + c.correction * error, posture, c.ik_damping).tolist()
        self._joints = [joint + step for joint, step in zip(self._joints, steps, strict=True)]
        before, self._rate = self._rate, [step / dt for step in steps]
        damping, stiffness = 2.0 * c.damping_ratio * c.bandwidth, c.bandwidth * c.bandwidth
        return [
            (now - last) / dt + damping * (now - rate) + stiffness * (wanted - joint)
            for now, last, rate, wanted, joint in zip(self._rate, before, rates, self._joints, joints, strict=True)
        ]
