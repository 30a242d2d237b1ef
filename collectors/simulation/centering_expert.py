"""Scripted expert of block centering, which lands on the block with one finger on purpose."""

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.centering import Scene
from svfl_data.schema.robot import Observation

STEP = np.array([0.025, 0.025, 0.025, np.pi / 16])  # bounds of the action: dx, dy, dz [m], dtheta [rad] (paper, 5.1)
OPEN = 1.0  # gripper opening in every action
CLEAR = 0.030  # [m] between fingertips and block where the expert slows down: it leaves the reference time to slow down
SLOW = 0.006  # [m] per step below that height, which is 0.12 m/s
ARRIVING = 1  # steps of rest after the last command: at that speed the reference is 38 ms late


class CollisionExpert:
    """Policy that moves above the block, comes down until a finger meets the block, pushes on and waits to arrive.

    The expert adds up its commands, because the measured height no longer shows the commanded height once the block
    holds the gripper up.
    """

    def __init__(self, scene: Scene, touchdown: float) -> None:
        """Plan the movement for a scene.

        Args:
            scene: Scene in which the expert acts.
            touchdown: Height of the TCP at which the fingertips reach the block's top, base z, [m].
        """
        self._goal = np.array([*scene.gripper_xy, touchdown - scene.push, scene.gripper_yaw])
        self._slow_from = touchdown + CLEAR
        self._commanded: np.ndarray | None = None  # x, y, z, theta
        self._rested = 0

    def __call__(self, observation: Observation) -> NDArray[np.float32] | None:
        """Return the next action, (5,) float32, or None when the push is over."""
        if self._commanded is None:
            self._commanded = observation.at("observations/proprio")[1:].astype(float)
        left = self._goal - self._commanded
        if np.allclose(left, 0, atol=1e-6):
            self._rested += 1
            return np.array([OPEN, 0.0, 0.0, 0.0, 0.0], np.float32) if self._rested <= ARRIVING else None
        height = self._commanded[2]
        above_place = np.all(np.abs(left[[0, 1, 3]]) < 1e-6)
        if not above_place:
            left[2] = max(self._slow_from - height, left[2])  # move sideways, but stay clear of the block
        elif height > self._slow_from + 1e-6:
            left[2] = self._slow_from - height
        else:
            left[2] = max(left[2], -SLOW)
        move = np.clip(left, -STEP, STEP)
        self._commanded += move
        return np.array([OPEN, *move], dtype=np.float32)
