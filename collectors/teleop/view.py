"""What a person sees while steering, and where it comes from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svfl_data.schema.robot import Calibration, Observation

FELT = 25
"""Readings whose mean is shown, and taken for contact: those of one action."""
CONTACT_N, RELEASE_N = 5.0, 2.5
"""Forces at which contact begins and ends, [N]: those of `svfl_data.signals.contact.ContactRule`."""


@dataclass(frozen=True)
class View:
    """One picture of the screen, in numbers.

    Attributes:
        task: Name of the task.
        observation: What is known now; its first camera is shown.
        calibration: Of that camera.
        workspace: Bounds of the TCP in base, (3, 2), [m].
        wrench: (6,) mean of the last readings, tared, [N] and [N m], base axes.
        contact: Whether the gripper is in contact.
        episode: Number of the episode that is, or will be, recorded.
        steps: Its length so far; None between episodes.
        saved: Episodes saved in this session.
        succeeded: How many of them succeeded.
        message: What happened last.
        pace: How steady the beat is, in words.
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
    """What the gripper feels now, (6,), [N] and [N m]."""
    return np.asarray(observation.wrench[-FELT:].mean(axis=0, dtype=np.float64))


def in_contact(before: bool, wrench: NDArray[np.float64]) -> bool:
    """Whether the gripper is in contact, with hysteresis.

    Args:
        before: Whether it was.
        wrench: What it feels, (6,).
    """
    return bool(np.linalg.norm(wrench[:3]) > (RELEASE_N if before else CONTACT_N))


def pixel(calibration: Calibration, point: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Where a point in base, (3,) [m], is in the picture, (2,) [px]; None if it is behind the camera."""
    T = calibration.T_base_camera
    seen = calibration.intrinsics @ (T[:3, :3].T @ (point - T[:3, 3]))
    return seen[:2] / seen[2] if seen[2] > 1e-6 else None
