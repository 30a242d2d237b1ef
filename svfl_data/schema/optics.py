"""Geometry of cameras: what must be known of a camera to use its images geometrically."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Calibration:
    """Calibration of a camera, needed to use its images geometrically; camera axes are x right, y down, z forward.

    Attributes:
        intrinsics: Pinhole matrix, shape (3, 3), [px]. The centre of the top left pixel is at (0, 0).
        T_base_camera: Pose of the camera in base, shape (4, 4), [m]; of a camera on the gripper, its pose now.
        image_axes: Orthogonal matrix from base (x, y) to image (right, up), shape (2, 2). It expresses a vector that is
            seen from above in the axes of the image.
        depth_scale: Metres per unit of depth, [m]; NaN for a camera without depth.
        T_tcp_camera: Pose of a camera that is mounted on the gripper, relative to the TCP, shape (4, 4), [m]. None for
            a fixed camera.

    Example:
        >>> Calibration(np.eye(3), np.eye(4), np.eye(2), depth_scale=1e-4).depth_scale
        0.0001
    """

    intrinsics: NDArray[np.float64]
    T_base_camera: NDArray[np.float64]
    image_axes: NDArray[np.float64]
    depth_scale: float = math.nan
    T_tcp_camera: NDArray[np.float64] | None = None

    def constants(self, camera: str) -> dict[str, NDArray[np.float64]]:
        """Return the arrays that an episode has of the calibration once, by dataset path.

        A camera that is mounted on the gripper has its mount in the place of a pose and of image axes.

        Args:
            camera: Name of the camera.
        """
        mount = {"T_tcp_camera": self.T_tcp_camera}
        still = {"T_base_camera": self.T_base_camera, "image_axes": self.image_axes}
        found = {"intrinsics": self.intrinsics} | (still if self.T_tcp_camera is None else mount)
        if not math.isnan(self.depth_scale):
            found["depth_scale"] = np.array(self.depth_scale)
        return {f"cameras/{camera}/{leaf}": np.array(values, np.float64) for leaf, values in found.items()}


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


def mounted(tcp: np.ndarray, T_tcp_camera: np.ndarray) -> np.ndarray:
    """Return the poses of a camera that is mounted on the gripper, shape (F, 4, 4), [m], base axes.

    Args:
        tcp: Poses of the TCP in base, position [m] and quat_xyzw, shape (F, 7).
        T_tcp_camera: Pose of the camera relative to the TCP, shape (4, 4), [m].
    """
    T_base_tcp = np.tile(np.eye(4), (len(tcp), 1, 1))
    T_base_tcp[:, :3, :3], T_base_tcp[:, :3, 3] = rotations(tcp[:, 3:]), tcp[:, :3]
    return np.asarray(T_base_tcp @ T_tcp_camera)


def rotations(quat_xyzw: np.ndarray) -> np.ndarray:
    """Return the matrices of rotations, shape (F, 3, 3).

    Args:
        quat_xyzw: Unit quaternions, shape (F, 4).
    """
    vector, w = quat_xyzw[:, :3], quat_xyzw[:, 3:, None]
    x, y, z = vector.T
    zero = np.zeros_like(x)
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), -1, 0)
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


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
