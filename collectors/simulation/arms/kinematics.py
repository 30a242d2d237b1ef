"""The arm's inner control loop, compiled to machine code because it runs 500 times a second.

The loop computes with a few dozen numbers. NumPy needs 20 us for it, mostly to make arrays of a few numbers; the
compiled code takes 3 us. Numba compiles the loop at its first use on a machine, which takes some seconds, and keeps the
result (`collectors.simulation.compiled`).

Below, an arm has A joints, and its fingers have two more, which come last.
"""

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.compiled import compiled

FINGERS = 2
Joints = tuple[float, ...]
"""A number for each of the A joints of the arm, then for the left and the right finger."""


@compiled
def joint_motion(
    jacobian: NDArray[np.float64], motion: NDArray[np.float64], posture: NDArray[np.float64], damping: float
) -> NDArray[np.float64]:
    """Return the joint motion for a small motion of the TCP, by differential inverse kinematics.

    dq = J# dx + (I - J# J) dq_posture with the damped pseudo-inverse J# = J^T (J J^T + damping^2 I)^-1. The inverse is
    computed by Cholesky decomposition. The second term moves the redundant joint without moving the gripper.

    Source: Siciliano, Sciavicco, Villani, Oriolo (2009), "Robotics: Modelling, Planning and Control", section 3.5.

    Args:
        jacobian: Geometric Jacobian of the TCP, (6, A), linear rows first, base axes.
        motion: Small motion of the TCP, (6,), [m] and [rad], base axes.
        posture: Joint motion that is carried out as far as it does not move the gripper, (A,), [rad].
        damping: Damping that keeps the joint motion finite near singular postures, [m] and [rad].

    Returns:
        Joint motion, (A,), [rad].
    """
    rows, columns = jacobian.shape
    lower = np.empty((rows, rows))
    solved = np.empty(rows)
    for i in range(rows):
        for j in range(i + 1):
            total = damping * damping if i == j else 0.0
            for k in range(columns):
                total += jacobian[i, k] * jacobian[j, k]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = np.sqrt(total) if i == j else total / lower[j, j]
        total = motion[i]
        for k in range(columns):
            total -= jacobian[i, k] * posture[k]
        for k in range(i):
            total -= lower[i, k] * solved[k]
        solved[i] = total / lower[i, i]
    for i in range(rows - 1, -1, -1):
        total = solved[i]
        for k in range(i + 1, rows):
            total -= lower[k, i] * solved[k]
        solved[i] = total / lower[i, i]
    step = posture.copy()
    for k in range(columns):
        for i in range(rows):
            step[k] += jacobian[i, k] * solved[i]
    return step


@compiled
def jacobian_array(
    linear: tuple[Joints, Joints, Joints], angular: tuple[Joints, Joints, Joints]
) -> NDArray[np.float64]:
    """Return the arm's columns of PyBullet's Jacobian of all moving joints, (6, A), linear rows first."""
    arm = len(linear[0]) - FINGERS
    out = np.empty((6, arm))
    for i in range(3):
        for k in range(arm):
            out[i, k], out[3 + i, k] = linear[i][k], angular[i][k]
    return out


@compiled
def gripper_velocity(jacobian: NDArray[np.float64], rates: Joints, above: float) -> tuple[float, float, float]:
    """Return the velocity of a point above the TCP of a gripper that points down.

    Args:
        jacobian: Geometric Jacobian of the TCP, (6, A), linear rows first, base axes.
        rates: Joint rates, [rad/s], of which the first A are the arm's.
        above: Height of the point above the TCP, [m].

    Returns:
        Velocity (x, y, z), [m/s], base axes.
    """
    v = np.zeros(6)
    for i in range(6):
        for k in range(jacobian.shape[1]):
            v[i] += jacobian[i, k] * rates[k]
    return v[0] + v[4] * above, v[1] - v[3] * above, v[2]


@compiled
def servo_acceleration(
    jacobian: NDArray[np.float64],
    motion: tuple[float, float, float, float, float, float],
    error: tuple[float, float, float, float, float, float],
    joints: Joints,
    rates: Joints,
    commanded: NDArray[np.float64],
    commanded_rates: NDArray[np.float64],
    gains: tuple[float, float, float, float, float],
    posture: NDArray[np.float64],
    dt: float,
) -> NDArray[np.float64]:
    """Move joint commands on so that they follow the TCP command, and return accelerations that follow the commands.

    `servo.Servo` explains the control law.

    Args:
        jacobian: Geometric Jacobian of the TCP, (6, A), linear rows first, base axes.
        motion: Commanded motion of the TCP in this step, six numbers, [m] and [rad], base axes.
        error: Commanded minus present pose of the TCP, six numbers, [m] and [rad], base axes.
        joints: Present joint angles, [rad], of which the first A are the arm's.
        rates: Present joint rates, [rad/s], of which the first A are the arm's.
        commanded: Commanded joint angles, (A,), [rad]. The function moves them on in place.
        commanded_rates: Commanded joint rates of the last step, (A,), [rad/s]. The function replaces them in place.
        gains: Bandwidth [rad/s], damping ratio, correction, damping of the inverse kinematics, and posture rate [1/s],
            as in `servo.ServoConfig`.
        posture: Joint angles to which the joints return as far as this does not move the gripper, (A,), [rad].
        dt: Control period, [s].

    Returns:
        Joint accelerations, (A,), [rad/s^2].
    """
    bandwidth, damping_ratio, correction, ik_damping, posture_rate = gains
    arm = jacobian.shape[1]
    wanted, back = np.empty(6), np.empty(arm)
    for i in range(6):
        wanted[i] = motion[i] + correction * error[i]
    for k in range(arm):
        back[k] = posture_rate * dt * (posture[k] - joints[k])
    step = joint_motion(jacobian, wanted, back, ik_damping)
    out = np.empty(arm)
    for k in range(arm):
        commanded[k] += step[k]
        rate, before = step[k] / dt, commanded_rates[k]
        commanded_rates[k] = rate
        out[k] = (
            (rate - before) / dt
            + 2.0 * damping_ratio * bandwidth * (rate - rates[k])
            + bandwidth * bandwidth * (commanded[k] - joints[k])
        )
    return out
