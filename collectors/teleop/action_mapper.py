"""Mapping from a device's reading to an action."""

import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import UsageError
from svfl_data.schema.field import Field

RAMP = 1 / 3
"""Largest change of speed per action, as a fraction of full speed: 3.3 m/s^2, as experts use.

With larger changes, inertia feels like contact."""
TURN = 0.5
"""Factor on the pace for turning; full speed would be 225 degrees per second."""
MOVES, TURNS, OPENING = ("dx", "dy", "dz"), ("dtheta", "rz"), "opening"
"""Names of the components of an action that a device commands. Other components stay at 0."""


class ActionMapper:
    """Mapper from readings of a device to actions in base axes, with a soft start and stop.

    Args:
        action: Declaration of the robot's action, with bounds: displacements dx, dy and dz [m] in base axes, and if the
            robot has them a rotation dtheta or rz about base z [rad] and a gripper opening.
        image_axes: Matrix from base xy to image (right, up), (2, 2), of the camera that the person looks through.
        pace: Fraction of full speed at full deflection, 0 to 1.

    Raises:
        UsageError: If the action has no such displacements, as one in joint space.
    """

    def __init__(self, action: Field, image_axes: NDArray[np.float64], pace: float) -> None:
        names = dict(zip(action.components, zip(action.bounds, action.delta, strict=False), strict=False))
        relative = [name for name, (_, delta) in names.items() if delta]
        if not set(MOVES) <= set(relative):
            raise UsageError(
                f"a person commands displacements {', '.join(MOVES)} of the gripper; the action of this robot is "
                f"{', '.join(action.components) or 'without names'}"
            )
        turn = [name for name in TURNS if name in relative][:1]
        self._columns = [action.components.index(name) for name in (*MOVES, *turn)]
        self._bound = np.array([min(-names[name][0][0], names[name][0][1]) for name in (*MOVES, *turn)])
        self._opening = action.components.index(OPENING) if OPENING in names else None
        self._open_range = names[OPENING][0] if OPENING in names else (0.0, 1.0)
        self._rest = np.zeros(len(action.components))
        self._axes = image_axes
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
            The action, (A,), base axes, [m] and [rad], within the bounds.
        """
        wanted = np.clip(reading[1:], -1.0, 1.0) * self._pace
        self._moving = self._moving + np.clip(wanted - self._moving, -RAMP, RAMP)
        xy = self._axes.T @ self._moving[:2]
        moving = np.clip([*xy, *self._moving[2:]], -1.0, 1.0)[: len(self._columns)]
        action = self._rest.copy()
        action[self._columns] = moving * self._bound
        if self._opening is not None:
            low, high = self._open_range
            action[self._opening] = low + np.clip(reading[0], 0.0, 1.0) * (high - low)
        return action.astype(np.float32)
