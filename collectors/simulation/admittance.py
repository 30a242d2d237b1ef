"""The Cartesian admittance law: how far the hand gives way to a force."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class AdmittanceConfig:
    """Fixed virtual mass, damping and stiffness of the hand's translation, the same in x, y and z.

    Rotation is not compliant: the hand stays vertical and its yaw follows the command.

    Attributes:
        stiffness: K, [N/m].
        damping: D, [N s/m].
        mass: M, [kg].
        max_deviation: The commanded position is kept this close to the hand along each axis, [m]; it bounds the force
            of a blocked hand to K times this.
    """

    stiffness: float = 2500.0
    damping: float = 300.0
    mass: float = 2.0
    max_deviation: float = 0.03


class Admittance:
    """Mass, spring and damper between the reference and the hand, one per axis, driven by the external force.

    With e the deviation of the hand from the reference, M e'' + D e' + K e = F. Written in the deviation, not the
    position, so that a free hand follows the reference without lag whatever M, D and K are.

    Source: Hogan (1985), "Impedance control: an approach to manipulation", part I (the target dynamics); Ott, Mukherjee
    and Nakamura (2010), "Unified impedance and admittance control", eq. 4 (position-controlled robot).
    """

    def __init__(self, config: AdmittanceConfig, dt: float) -> None:
        """Start at rest on the reference.

        Args:
            config: Stiffness, damping and mass.
            dt: Control period, [s].
        """
        self._stiffness = config.stiffness
        self._dt = dt
        self._effective_mass = config.mass + dt * config.damping + dt * dt * config.stiffness
        self._mass = config.mass
        self.deviation = np.zeros(3)
        self.rate = np.zeros(3)

    def step(self, force: NDArray[np.float64]) -> None:
        """Advance `deviation` [m] and `rate` [m/s] by one period.

        Implicit Euler, stable for every positive M, D, K:
        (M + dt D + dt^2 K) e'_next = M e' + dt (F - K e).

        Args:
            force: What the surroundings push the hand with, (3,), [N], base axes; no weight, no inertia of the hand.
        """
        impulse = self._mass * self.rate + self._dt * (force - self._stiffness * self.deviation)
        self.rate = impulse / self._effective_mass
        self.deviation = self.deviation + self._dt * self.rate
