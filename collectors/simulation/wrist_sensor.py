"""The simulated six-axis force-torque sensor between the arm's flange and the gripper."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.bullet import pybullet

# In this mode PyBullet reports the reaction at a joint in base axes and about the joint's origin. Without it, PyBullet
# reports the reaction in the axes of the child link and about its centre of mass. This was found by experiment
# (pybullet 3.2.7), and a test checks it.
FEEDBACK_MODE = pybullet.JOINT_FEEDBACK_IN_JOINT_FRAME | pybullet.JOINT_FEEDBACK_IN_WORLD_SPACE


def wrench_from_reaction(reaction: Sequence[float]) -> tuple[float, ...]:
    """Turn the reaction of a joint into the reading of a sensor in that joint, which is the load on the gripper.

    PyBullet gives the force of the parent (flange) on the child (gripper). The sensor reads the opposite: the force of
    the environment, gravity and the gripper's own inertia on the gripper, F_external + m g - m a.

    Args:
        reaction: Force and torque of the flange on the gripper, six numbers, [N] and [N m], base axes, about the
            sensor origin.

    Returns:
        Load on the gripper, six numbers, [N] and [N m], base axes, about the sensor origin.
    """
    return tuple([-part for part in reaction])


class WristReadings:
    """All readings of the sensor since a reset, in pieces of one action each.

    Args:
        first: Readings before the first action, shape (M, 6), [N] and [N m], base axes, about the sensor origin.
        period_ns: Time between two readings, [ns].
    """

    def __init__(self, first: NDArray[np.float32], period_ns: int) -> None:
        self._pieces, self._period_ns = [first], period_ns
        self._length, self._new = len(first), 1  # number of readings, and of pieces that `new` has not returned

    def append(self, wrenches: NDArray[np.float32]) -> None:
        """Append the readings of an action, shape (M, 6)."""
        self._pieces.append(wrenches)
        self._length += len(wrenches)
        self._new += 1

    def last(self, count: int) -> NDArray[np.float32]:
        """Return the last readings, shape (count, 6), or fewer if there are not so many."""
        pieces, found = 0, 0
        while found < count and pieces < len(self._pieces):
            pieces += 1
            found += len(self._pieces[-pieces])
        return np.concatenate(self._pieces[-pieces:])[-count:]

    def new(self) -> dict[str, np.ndarray]:
        """Return the readings since the last call of this method: ``t_ns``, (M,), [ns], and ``wrench``, (M, 6)."""
        pieces, self._new = self._pieces[len(self._pieces) - self._new :], 0
        wrench = np.concatenate(pieces) if pieces else np.zeros((0, 6), np.float32)
        return {"t_ns": self._times(self._length - len(wrench), self._length), "wrench": wrench}

    @property
    def wrench(self) -> NDArray[np.float32]:
        """All readings, shape (M, 6)."""
        return np.concatenate(self._pieces)

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Time of each reading, shape (M,), [ns]. The first reading is one period after the reset."""
        return self._times(0, self._length)

    def last_times(self, count: int) -> NDArray[np.int64]:
        """Return the times of the last readings, shape (count,), [ns], or fewer if there are not so many."""
        return self._times(max(0, self._length - count), self._length)

    def _times(self, start: int, stop: int) -> NDArray[np.int64]:
        return np.arange(start + 1, stop + 1, dtype=np.int64) * self._period_ns
