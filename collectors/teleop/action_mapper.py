"""Mapping from a device's reading to an action."""

import numpy as np
from numpy.typing import NDArray

RAMP = 1 / 3
"""Largest change of speed per action, as a fraction of full speed: 3.3 m/s^2, as experts use.

With larger changes, inertia feels like contact."""
TURN = 0.5
"""Factor on the pace for turning; full speed would be 225 degrees per second."""


class ActionMapper:
    """Mapper from readings of a device to actions in base axes, with a soft start and stop.

    Args:
        bound: Largest |dx|, |dy|, |dz| [m] and |dtheta| [rad] of an action, (4,).
        image_axes: Matrix from base xy to image (right, up), (2, 2), of the camera that the person looks through.
        pace: Fraction of full speed at full deflection, 0 to 1.
    """

    def __init__(self, bound: NDArray[np.float64], image_axes: NDArray[np.float64], pace: float) -> None:
        self._bound, self._axes = bound, image_axes
        self._pace = pace * np.array([1.0, 1.0, 1.0, TURN])
        self.begin()

    def begin(self) -> None:
        """Reset the motion to rest, which is the state of the gripper when an episode begins."""
        self._moving = np.zeros(4)

    def action(self, reading: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the next action, whose speed differs from that of the last action by at most `RAMP`.

        Args:
            reading: Reading from `Device.read`, (5,).

        Returns:
            The action (opening, dx, dy, dz, dtheta), (5,), base axes, [m] and [rad], within the bounds.
        """
        wanted = np.clip(reading[1:], -1.0, 1.0) * self._pace
        self._moving = self._moving + np.clip(wanted - self._moving, -RAMP, RAMP)
        xy = self._axes.T @ self._moving[:2]
        move = np.clip([*xy, *self._moving[2:]], -1.0, 1.0) * self._bound
        return np.array([np.clip(reading[0], 0.0, 1.0), *move], np.float32)
