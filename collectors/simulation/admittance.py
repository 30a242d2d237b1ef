"""The Cartesian admittance law, which computes how far the gripper yields to a force."""

import math
from dataclasses import dataclass

from collectors.simulation.bounds import NotNegative, Positive, Vector3

ZERO: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class AdmittanceConfig:
    """Fixed virtual mass, damping and stiffness of the gripper's translation, the same in x, y and z.

    Rotation is not compliant: the gripper stays vertical and its yaw follows the command.

    Attributes:
        stiffness: Virtual stiffness K, [N/m].
        damping: Virtual damping D, [N s/m]. The default is 0.7 of the critical damping 2 sqrt(K M).
        mass: Virtual mass M, [kg]. The default is about twice the gripper's own mass, because the control loop must not
            depend on making the gripper lighter than it is.
        filter_hz: Corner frequency of the first-order low-pass on the force that drives the law, [Hz]. Without the
            filter, a sticking finger and the controller push against each other at half the sampling rate.
        max_deviation: Largest distance of the commanded position from the gripper along each axis, [m]. It bounds the
            force of a blocked gripper to K times this distance.
    """

    stiffness: Positive = 2500.0
    damping: NotNegative = 100.0
    mass: Positive = 2.0
    filter_hz: Positive = 30.0
    max_deviation: Positive = 0.03


class Admittance:
    """Mass, spring and damper between the reference and the gripper, one per axis, driven by the external force.

    With e the deviation of the gripper from the reference, the law is M e'' + D e' + K e = F. It is written in the
    deviation, not the position, so that a free gripper follows the reference without lag whatever M, D and K are.

    The state is plain floats: for three numbers NumPy would take twice as long, 500 times a second.

    Source: Hogan (1985), "Impedance control: an approach to manipulation", part I (the target dynamics); Ott, Mukherjee
    and Nakamura (2010), "Unified impedance and admittance control" (realised by a position-controlled robot).

    Attributes:
        deviation: Position of the gripper minus that of the reference, (x, y, z), [m], base axes.
        rate: Time derivative of the deviation, (x, y, z), [m/s], base axes.
    """

    def __init__(self, config: AdmittanceConfig, dt: float) -> None:
        """Start at rest on the reference.

        Args:
            config: Stiffness, damping, mass and filter of the law.
            dt: Control period, [s].
        """
        self._config = config
        self._dt = dt
        self._inertia = config.mass + dt * config.damping + dt * dt * config.stiffness
        # Exact discretisation of a first-order lag: y += gain (u - y).
        self._filter_gain = 1.0 - math.exp(-2.0 * math.pi * config.filter_hz * dt)
        self._force = ZERO
        self.deviation = ZERO
        self.rate = ZERO

    def step(self, force: Vector3) -> None:
        """Advance the state by one period.

        The period is integrated by implicit Euler, which is stable for every positive M, D and K:
        (M + dt D + dt^2 K) e'_next = M e' + dt (F - K e).

        Args:
            force: Force of the environment on the gripper, (x, y, z), [N], base axes, without the weight and the
                inertia of the gripper.
        """
        c, dt = self._config, self._dt
        axes = zip(force, self._force, self.deviation, self.rate, strict=True)
        after = [self._step_axis(c.mass, c.stiffness, dt, *axis) for axis in axes]
        self._force, self.deviation, self.rate = zip(*after, strict=True)

    def _step_axis(
        self, mass: float, stiffness: float, dt: float, force: float, felt: float, deviation: float, rate: float
    ) -> Vector3:
        felt += self._filter_gain * (force - felt)
        rate = (mass * rate + dt * (felt - stiffness * deviation)) / self._inertia
        return felt, deviation + dt * rate, rate
