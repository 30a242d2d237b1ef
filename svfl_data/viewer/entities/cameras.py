"""The cameras of an episode: lens and pose are logged once or as the camera moves, the images as rows."""

import numpy as np
import rerun as rr

from svfl_data.schema.optics import mounted
from svfl_data.system.printable import printable
from svfl_data.system.progress import progress
from svfl_data.viewer.entities import images
from svfl_data.viewer.entities.episode_source import TCP_POSE, TCP_TIMES, EpisodeSource

FRAMES_AT_ONCE = 256
EXACT_BYTES = 2**26
"""Largest size of a camera's images of one kind that are logged exactly, [bytes]: 3800 colour frames of 76 x 76, three
minutes."""


def log_camera(recording: rr.RecordingStream, shown: EpisodeSource, camera: str) -> None:
    """Log the calibration, the pose and all images of a camera.

    Args:
        recording: Recording to log to.
        shown: Episode that is shown.
        camera: Name of the camera.
    """
    entity, group = shown.camera_entity(camera), f"cameras/{camera}"
    paths, clock = shown.declarations.image_paths(camera, shown.arrays), shown[f"{group}/t_ns"]
    height, width = shown.arrays[paths[0]].shape[1:3]
    if shown.placed(camera):
        images.log_lens(recording, entity, shown[f"{group}/intrinsics"], (height, width))
        _log_pose(recording, shown, camera, clock)
    if f"{group}/color" in shown:
        images.log_crop(recording, entity, (height, width))
    small = any(_bytes(shown, path) > EXACT_BYTES for path in paths)
    rows = len(clock)
    pieces = range(0, rows, FRAMES_AT_ONCE)
    for first in progress(pieces, printable(f"pictures of {camera}")) if small else pieces:
        piece = slice(first, min(first + FRAMES_AT_ONCE, rows))
        for path in paths:
            pictures = np.asarray(shown.arrays[path][piece])
            if path != f"{group}/depth":
                images.send_images(recording, image_entity(shown, path), clock[piece], pictures, small)
                continue
            if first == 0:
                scale = float(shown[f"{group}/depth_scale"])
                images.log_depth_style(recording, entity, pictures, scale, small)
            images.send_depth(recording, entity, clock[piece], pictures, small)
        recording.flush()


def image_entity(shown: EpisodeSource, path: str) -> str:
    """Return the entity of the images of a camera.

    Args:
        shown: Episode that is shown.
        path: Dataset path of the images.
    """
    _, camera, kind = path.split("/")
    return f"{shown.camera_entity(camera)}/{rr.escape_entity_path_part(kind)}"


def poses(shown: EpisodeSource, camera: str, t_ns: np.ndarray) -> np.ndarray:
    """Return the pose of a camera that moves at each of its frames, shape (F, 4, 4), [m], base axes.

    Args:
        shown: Episode that is shown.
        camera: Name of a camera that moves by itself, or with the gripper on which it is mounted.
        t_ns: Times of the frames, shape (F,), [ns].

    Returns:
        Poses; NaN at frames before the first pose of the TCP.
    """
    if f"cameras/{camera}/T_base_camera_per_frame" in shown:
        return shown[f"cameras/{camera}/T_base_camera_per_frame"]
    rows = np.searchsorted(shown[TCP_TIMES], t_ns, side="right") - 1  # the latest pose at or before the frame
    tcp = shown[TCP_POSE][np.maximum(rows, 0)] if len(shown.arrays[TCP_POSE]) else np.zeros((len(t_ns), 7))
    T_base_camera = mounted(tcp, shown[f"cameras/{camera}/T_tcp_camera"])
    T_base_camera[rows < 0] = np.nan
    return T_base_camera


def _log_pose(recording: rr.RecordingStream, shown: EpisodeSource, camera: str, t_ns: np.ndarray) -> None:
    entity, group = shown.camera_entity(camera), f"cameras/{camera}"
    if f"{group}/T_base_camera" in shown:
        pose = shown[f"{group}/T_base_camera"]
        recording.log(entity, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
    else:
        images.send_poses(recording, entity, t_ns, poses(shown, camera, t_ns))


def _bytes(shown: EpisodeSource, path: str) -> int:
    array = shown.arrays[path]
    return int(np.prod(array.shape)) * array.dtype.itemsize
