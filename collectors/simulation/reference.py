"""The commanded pose between two 20 Hz actions."""

import numpy as np
from numpy.typing import NDArray


class Reference:
    """Spreads each action over the physics steps of a tick: a short ramp from the last velocity, then constant speed.

    The commanded pose is reached exactly at the end of the tick. Equal actions in a row run at constant velocity, so
    that the hand's inertia does not disturb the wrist readings; a change of velocity is spread over the ramp
    (linear segments with parabolic blends: Craig 2005, "Introduction to Robotics", section 7.3).
    """

    def __init__(self, steps: int, blend_steps: int) -> None:
        """Start at rest.

        Args:
            steps: Physics steps in a tick.
            blend_steps: Length of the ramp, in physics steps.
        """
        self._ramp = np.minimum((np.arange(steps) + 0.5) / blend_steps, 1.0)
        self._last = np.zeros(4)

    def moves(self, action: NDArray[np.float64]) -> NDArray[np.float64]:
        """Divide an action into the motions of its physics steps.

        Args:
            action: Commanded motion (dx, dy, dz, dtheta) of the tick, (4,), [m] and [rad].

        Returns:
            Motion of every physics step, (steps, 4), [m] and [rad]; they add up to the action.
        """
        cruise = (action - np.sum(1.0 - self._ramp) * self._last) / np.sum(self._ramp)
        moves = np.outer(1.0 - self._ramp, self._last) + np.outer(self._ramp, cruise)
        self._last = cruise
        return moves
