"""The contract of robots and policies: what is observed at a step, and what a recording loop asks of a robot."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Frame:
    """What one camera sees at one moment.

    Attributes:
        color: (H, W, 3) uint8 RGB.
        depth: (H, W) uint16, in units of the camera's depth scale, 0 = nothing seen.

    Example:
        >>> Frame(np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint16)).depth.shape
        (4, 4)
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]


@dataclass(frozen=True)
class Observation:
    """What is known at one step.

    Attributes:
        t_ns: Time of the latest reading, [ns] of the episode clock.
        frames: What each camera sees, by name.
        wrench: (64, 6) float32: the last readings, latest last, tared, [N] and [N m], base axes, about the sensor
            origin.
        proprio: (5,) float32: gripper opening 0..1, TCP x, y, z [m], yaw theta [rad], in base.
        joints: (J,) float32: arm joints [rad], then fingers [m].

    Example:
        >>> seen = Observation(0, {}, np.zeros((64, 6)), proprio=np.zeros(5), joints=np.zeros(9))
        >>> seen.wrench.shape
        (64, 6)
    """

    t_ns: int
    frames: dict[str, Frame]
    wrench: NDArray[np.float32]
    proprio: NDArray[np.float32]
    joints: NDArray[np.float32]


@dataclass(frozen=True)
class Calibration:
    """What one needs to use the images geometrically. Camera axes: x right, y down, z forward.

    Attributes:
        intrinsics: Pinhole matrix, (3, 3), [px]; the centre of the first pixel is at (0, 0).
        T_base_camera: Pose of the camera in base, (4, 4), [m].
        image_axes: Base xy to image (right, up), (2, 2), orthogonal: a vector seen from above in the picture's axes.
        depth_scale: Metres per unit of depth, [m].

    Example:
        >>> Calibration(np.eye(3), np.eye(4), np.eye(2), depth_scale=1e-4).depth_scale
        0.0001
    """

    intrinsics: NDArray[np.float64]
    T_base_camera: NDArray[np.float64]
    image_axes: NDArray[np.float64]
    depth_scale: float


def image_axes(T_base_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Base xy to image (right, up) of a camera that looks at the table, (2, 2), orthogonal.

    Args:
        T_base_camera: Its pose, (4, 4).

    Example:
        >>> looking_down = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> image_axes(looking_down).tolist()
        [[1.0, 0.0], [-0.0, 1.0]]
    """
    x, y = T_base_camera[:2, 0] / np.linalg.norm(T_base_camera[:2, 0])
    above = -np.sign(T_base_camera[2, 2])  # a camera that looks up sees a mirrored table
    return np.array([[x, y], [-above * y, above * x]])


class Optics(Protocol):
    """The geometry of a camera: a `Calibration` has it, and so has a recorded `svfl_data.schema.episode.Camera`."""

    @property
    def intrinsics(self) -> np.ndarray:
        """Pinhole matrix, (3, 3), [px]."""

    @property
    def T_base_camera(self) -> np.ndarray:
        """Pose of the camera in base, (4, 4), [m]."""

    @property
    def image_axes(self) -> np.ndarray:
        """Base (x, y) to image (right, up), (2, 2)."""

    @property
    def depth_scale(self) -> float | np.ndarray:
        """Metres per unit of depth."""


class Robot(Protocol):
    """A robot with its sensors, homed and tared.

    One step is `observe`, then `step` with the action commanded after it. The wrench stream runs by itself at the
    sensor's own rate.

    Example:
        >>> def moves(robot: Robot) -> bool:
        ...     before = robot.observe()
        ...     robot.step(np.array([1.0, 0.01, 0.0, 0.0, 0.0], np.float32))
        ...     return not np.array_equal(before.proprio, robot.observe().proprio)
    """

    tare_offset: NDArray[np.float32]

    @property
    def cameras(self) -> dict[str, Calibration]:
        """Calibration of its cameras, by name."""

    @property
    def workspace(self) -> NDArray[np.float64]:
        """Bounds of the TCP in base axes, shape (3, 2), [m]."""

    @property
    def wrench_t_ns(self) -> NDArray[np.int64]:
        """Time of every reading since the episode began, shape (M,), [ns]."""

    @property
    def wrench(self) -> NDArray[np.float32]:
        """Those readings, raw, shape (M, 6), [N] and [N m], base axes, about the sensor origin."""

    def observe(self) -> Observation:
        """See and feel now."""

    def step(self, action: NDArray[np.float32]) -> None:
        """Carry out one action (opening, dx, dy, dz, dtheta) for one step of 50 ms."""


Policy = Callable[[Observation], NDArray[np.float32] | None]
"""Gives the next action, or None to end the episode."""
