"""View that a person sees while steering, and the functions that compute it."""

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
        observation: Latest observation, whose first camera is shown.
        calibration: Calibration of that camera.
        workspace: Bounds of the TCP in base, (3, 2), [m].
        wrench: Mean of the last readings, tared, (6,), [N] and [N m], base axes.
        contact: Whether the gripper is in contact.
        episode: Number of the episode that is, or will be, recorded.
        steps: Number of steps of the episode so far; None between episodes.
        saved: Number of episodes saved in this session.
        succeeded: Number of saved episodes that succeeded.
        message: Message about the latest event.
        pace: Text on how steady the beat is.
    """

    task: str
    observation: Observation
    calibration: Calibration
    workspace: NDArray[np.float64]
    wrench: NDArray[np.float64]
    contact: bool
    episode: int
    steps: int | None
    saved: int
    succeeded: int
    message: str
    pace: str


def felt(observation: Observation) -> NDArray[np.float64]:
    """Return the mean wrench of the last `FELT` readings of an observation, (6,), [N] and [N m], base axes.

    Args:
        observation: Observation with the tared wrench readings, base axes.
    """
    return np.asarray(observation.wrench[-FELT:].mean(axis=0, dtype=np.float64))


def in_contact(before: bool, wrench: NDArray[np.float64]) -> bool:
    """Return whether the gripper is in contact, with hysteresis.

    Args:
        before: Whether the gripper was in contact at the time before.
        wrench: Mean wrench of the last readings, tared, (6,), [N] and [N m].
    """
    return bool(np.linalg.norm(wrench[:3]) > (RELEASE_N if before else CONTACT_N))


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
