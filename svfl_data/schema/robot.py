"""Interface between robots and policies: what is observed at a step, and what a recording loop asks of a robot."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Frame:
    """Images of one camera at one moment.

    Attributes:
        color: Colour image, shape (H, W, 3), uint8, RGB.
        depth: Depth image, shape (H, W), uint16, in units of the camera's depth scale; 0 where there is no measurement.

    Example:
        >>> Frame(np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint16)).depth.shape
        (4, 4)
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]


@dataclass(frozen=True)
class Observation:
    """Data that a robot observes at one step.

    Attributes:
        t_ns: Time of the latest reading, [ns] of the episode clock.
        frames: Frame of each camera by name.
        wrench: Last 64 wrench readings, latest last, shape (64, 6), float32, tared, [N] and [N m], base axes, about the
            sensor origin.
        proprio: Proprioception, shape (5,), float32: gripper opening (0 closed, 1 open), TCP x, y, z [m] and yaw theta
            [rad], in base.
        joints: Joint positions, shape (J,), float32: arm joints [rad], then fingers [m].
        tcp: Measured pose of the TCP in base, position [m], then quat_xyzw, shape (7,). None if nothing needs it, since
            no camera is mounted on the gripper.

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
    tcp: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Calibration:
    """Calibration of a camera, needed to use its images geometrically; camera axes are x right, y down, z forward.

    Attributes:
        intrinsics: Pinhole matrix, shape (3, 3), [px]. The centre of the top left pixel is at (0, 0).
        T_base_camera: Pose of the camera in base, shape (4, 4), [m]; of a camera on the gripper, its pose now.
        image_axes: Orthogonal matrix from base (x, y) to image (right, up), shape (2, 2). It expresses a vector that is
            seen from above in the axes of the image.
        depth_scale: Metres per unit of depth, [m].
        T_tcp_camera: Pose of a camera that is mounted on the gripper, relative to the TCP, shape (4, 4), [m]. None for
            a camera that stands still.

    Example:
        >>> Calibration(np.eye(3), np.eye(4), np.eye(2), depth_scale=1e-4).depth_scale
        0.0001
    """

    intrinsics: NDArray[np.float64]
    T_base_camera: NDArray[np.float64]
    image_axes: NDArray[np.float64]
    depth_scale: float
    T_tcp_camera: NDArray[np.float64] | None = None


def image_axes(T_base_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix from base (x, y) to image (right, up) of a camera that looks at the table.

    Args:
        T_base_camera: Pose of the camera in base, shape (4, 4), [m].

    Returns:
        Orthogonal matrix, shape (2, 2).

    Example:
        >>> looking_down = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> image_axes(looking_down).tolist()
        [[1.0, 0.0], [-0.0, 1.0]]
    """
    x, y = T_base_camera[:2, 0] / np.linalg.norm(T_base_camera[:2, 0])
    above = -np.sign(T_base_camera[2, 2])  # a camera that looks up sees a mirrored table
    return np.array([[x, y], [-above * y, above * x]])


class Optics(Protocol):
    """Geometry of a camera, as in a `Calibration` or a recorded `svfl_data.schema.episode.Camera`."""

    @property
    def intrinsics(self) -> np.ndarray:
        """Pinhole matrix, shape (3, 3), [px]."""

    @property
    def T_base_camera(self) -> np.ndarray:
        """Pose of the camera in base, shape (4, 4), [m]."""

    @property
    def image_axes(self) -> np.ndarray:
        """Orthogonal matrix from base (x, y) to image (right, up), shape (2, 2)."""

    @property
    def depth_scale(self) -> float | np.ndarray:
        """Metres per unit of depth, [m]."""


class Robot(Protocol):
    """Protocol of a robot with its sensors, which is homed and tared.

    One step is a call of `observe`, then a call of `step` with the action that is commanded after the observation. The
    wrench stream runs by itself at the sensor's own rate.

    Attributes:
        tare_offset: Offset to subtract from the raw wrench, shape (6,), [N] and [N m], base axes, about the sensor
            origin.

    Example:
        >>> def moves(robot: Robot) -> bool:
        ...     before = robot.observe()
        ...     robot.step(np.array([1.0, 0.01, 0.0, 0.0, 0.0], np.float32))
        ...     return not np.array_equal(before.proprio, robot.observe().proprio)
    """

    tare_offset: NDArray[np.float32]

    @property
    def cameras(self) -> dict[str, Calibration]:
        """Calibration of each camera of the robot by name."""

    @property
    def workspace(self) -> NDArray[np.float64]:
        """Lower and upper bound of the TCP position x, y, z in base axes, shape (3, 2), [m]."""

    @property
    def wrench_t_ns(self) -> NDArray[np.int64]:
        """Time of every wrench reading since the episode began, shape (M,), [ns] of the episode clock."""

    @property
    def wrench(self) -> NDArray[np.float32]:
        """Raw wrench readings of the episode so far, (M, 6), [N] and [N m], base axes, about the sensor origin."""

    def observe(self) -> Observation:
        """Return the observation of the present moment."""

    def step(self, action: NDArray[np.float32]) -> None:
        """Carry out one action for one step of 50 ms.

        Args:
            action: Gripper opening (0 closed, 1 open), dx, dy, dz [m], dtheta [rad], base axes, shape (5,).
        """


Policy = Callable[[Observation], NDArray[np.float32] | None]
"""Function that returns the next action for an observation, or None to end the episode."""
