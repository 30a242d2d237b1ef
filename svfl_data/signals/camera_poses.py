"""Poses of cameras that move, alone or with the gripper, and how their images are rotated about the vertical."""

from collections.abc import Collection, Mapping

import numpy as np

from svfl_data.schema.optics import mounted
from svfl_data.schema.validity import Readable

TCP_TIMES, TCP_POSE = "streams/tcp/t_ns", "streams/tcp/pose"


def moves(paths: Collection[str], camera: str) -> bool:
    """Return whether a camera moves and its pose is known at every frame.

    Args:
        paths: Dataset paths of the arrays of an episode.
        camera: Name of the camera.
    """
    return any(set(needed) <= set(paths) for needed in (_per_frame(camera), _mounted(camera)))


def pose_paths(paths: Collection[str], camera: str) -> list[str]:
    """Return the paths of the arrays that the poses of a camera that moves follow from, without its clock.

    Args:
        paths: Dataset paths of the arrays of an episode.
        camera: Name of a camera that moves.
    """
    return _per_frame(camera) if set(_per_frame(camera)) <= set(paths) else _mounted(camera)


def camera_poses(arrays: Mapping[str, Readable], camera: str, t_ns: np.ndarray) -> np.ndarray:
    """Return the pose of a camera that moves at each of its frames, shape (F, 4, 4), [m], base axes.

    A camera that is mounted on the gripper has, at a frame, the pose that follows from the latest pose of the TCP at or
    before the frame.

    Args:
        arrays: Arrays of an episode by dataset path.
        camera: Name of a camera that moves by itself, or with the gripper on which it is mounted.
        t_ns: Times of the frames, shape (F,), [ns].

    Returns:
        Poses; NaN at frames before the first pose of the TCP.
    """
    recorded = f"cameras/{camera}/T_base_camera_per_frame"
    if recorded in arrays:
        return np.asarray(arrays[recorded][0 : len(t_ns)])
    times = np.asarray(arrays[TCP_TIMES][0 : 2**62])
    if not len(times):
        return np.full((len(t_ns), 4, 4), np.nan)
    rows = np.searchsorted(times, t_ns, side="right") - 1
    tcp = np.asarray(arrays[TCP_POSE][0 : len(times)])[np.maximum(rows, 0)]
    poses = mounted(tcp, np.asarray(arrays[f"cameras/{camera}/T_tcp_camera"][0:4]))
    poses[rows < 0] = np.nan
    return poses


def frame_axes(poses: np.ndarray) -> np.ndarray:
    """Return the matrix from base (x, y) to image (right, up) of each pose of a camera, shape (F, 2, 2).

    It is `svfl_data.schema.optics.image_axes` for many poses at once. Where it does not exist, it is the identity: at
    an unknown pose, and at one whose image has its right straight up or down.

    Args:
        poses: Poses of the camera in base, shape (F, 4, 4), [m]; NaN where a pose is unknown.
    """
    right = poses[:, :2, 0]
    length = np.linalg.norm(right, axis=1, keepdims=True)
    known = (length > 1e-9).all(axis=1)  # false for NaN as well
    x, y = np.divide(right, length, out=np.zeros_like(right), where=known[:, None]).T
    above = np.where(poses[:, 2, 2] > 0, -1.0, 1.0)  # a camera that looks up sees a mirrored table
    axes = np.stack([np.stack([x, y], -1), np.stack([-above * y, above * x], -1)], axis=1)
    axes[~known] = np.eye(2)
    return axes


def _per_frame(camera: str) -> list[str]:
    return [f"cameras/{camera}/T_base_camera_per_frame"]


def _mounted(camera: str) -> list[str]:
    return [f"cameras/{camera}/T_tcp_camera", TCP_TIMES, TCP_POSE]
