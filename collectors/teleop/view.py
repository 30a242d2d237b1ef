"""View that a person sees during teleoperation, and the functions that compute it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svfl_data.schema.robot import Calibration, Observation

FELT = 25
"""Number of readings whose mean is shown and compared with the contact thresholds: those of one action."""
CONTACT_N, RELEASE_N = 5.0, 2.5
"""Forces at which contact begins and ends, [N], equal to those of `svfl_data.signals.contact.ContactRule`."""


@dataclass(frozen=True)
class View:
    """Content of the screen at one moment, in numbers.

    Attributes:
        task: Name of the task.
        observation: Latest observation.
        camera: Name of the camera that is shown. None if the robot has no camera.
        calibration: Calibration of that camera. None if it is unknown.
        workspace: Bounds of the TCP in base, (3, 2), [m]. None if the robot has none.
        wrench: Mean of the last readings, tared, (6,), [N] and [N m], base axes. None on a robot without such a sensor.
        contact: Whether the gripper is in contact.
        episode: Number of the episode that is, or will be, recorded.
        seconds: Duration of the episode so far, [s]; None between episodes.
        saved: Number of episodes saved in this session.
        succeeded: Number of saved episodes that succeeded.
        message: Message about the latest event.
        pace: Text on how steady the beat is.
    """

    task: str
    observation: Observation
    camera: str | None
    calibration: Calibration | None
    workspace: NDArray[np.float64] | None
    wrench: NDArray[np.float64] | None
    contact: bool
    episode: int
    seconds: float | None
    saved: int
    succeeded: int
    message: str
    pace: str


def felt(observation: Observation) -> NDArray[np.float64] | None:
    """Return the mean wrench of the last `FELT` readings of an observation, (6,), [N] and [N m], base axes.

    Args:
        observation: Observation with the tared wrench readings, base axes; without them None is returned.
    """
    if observation.wrench is None:
        return None
    return np.asarray(observation.wrench[-FELT:].mean(axis=0, dtype=np.float64))


def in_contact(before: bool, wrench: NDArray[np.float64] | None) -> bool:
    """Return whether the gripper is in contact, with hysteresis.

    Args:
        before: Whether the gripper was in contact at the time before.
        wrench: Mean wrench of the last readings, tared, (6,), [N] and [N m]. None if nothing measures it.
    """
    return wrench is not None and bool(np.linalg.norm(wrench[:3]) > (RELEASE_N if before else CONTACT_N))


def pixel(calibration: Calibration, point: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return where a point is in a camera's picture.

    Args:
        calibration: Calibration of the camera.
        point: Point in base, (3,), [m].

    Returns:
        The position in the picture, (2,), [px], or None if the point is behind the camera.
    """
    T = calibration.T_base_camera
    seen = calibration.intrinsics @ (T[:3, :3].T @ (point - T[:3, 3]))
    return seen[:2] / seen[2] if seen[2] > 1e-6 else None
