"""What a calibration is made of: pictures in a folder or an episode, and poses in a table."""

import argparse
import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import FormatError, StorageError, UsageError

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
FRAMES = 50  # of an episode that are looked at: more of the same tell no more
COLUMNS = ("picture", "x", "y", "z", "qx", "qy", "qz", "qw")
DEPTH_SCALE = 0.001  # [m], of most depth cameras


@dataclass(frozen=True)
class Pictures:
    """Pictures of one camera.

    Attributes:
        pictures: Name of each, and how to get it, (H, W) or (H, W, 3) uint8.
        intrinsics: Pinhole matrix, (3, 3), [px].
        depth_scale: Metres per unit of depth, [m].
    """

    pictures: list[tuple[str, Callable[[], NDArray[np.uint8]]]]
    intrinsics: NDArray[np.float64]
    depth_scale: float


def of_folder(arguments: argparse.Namespace) -> Pictures:
    """Every picture in the folder ``path``, by file name.

    Raises:
        UsageError: If there is none, or no ``--intrinsics``.
    """
    files = sorted(file for file in arguments.path.iterdir() if file.suffix.lower() in SUFFIXES)
    if not files:
        raise UsageError(f"{arguments.path}: no pictures there ({', '.join(SUFFIXES)})")
    if not arguments.intrinsics:
        raise UsageError(f"{arguments.path}: pictures in a folder need --intrinsics FX,FY,CX,CY")
    fx, fy, cx, cy = arguments.intrinsics
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    scale = DEPTH_SCALE if arguments.depth_scale is None else arguments.depth_scale
    return Pictures([(file.name, partial(_read, file)) for file in files], K, scale)


def of_episode(arguments: argparse.Namespace) -> Pictures:
    """At most `FRAMES` frames of the camera ``--camera`` of an episode, named by their number.

    Raises:
        UsageError: If it has no such camera.
    """
    from svfl_data.verbs.source import read

    episode = read(arguments.path, arguments.episode)
    if arguments.camera not in episode.cameras:
        raise UsageError(
            f"{episode.name}: no camera {arguments.camera!r}; its cameras are {', '.join(episode.cameras)}"
        )
    camera = episode.cameras[arguments.camera]
    rows = np.unique(np.linspace(0, len(camera.color) - 1, FRAMES).astype(int)).tolist()
    own = float(camera.depth_scale) if camera.has("depth_scale") else DEPTH_SCALE
    scale = own if arguments.depth_scale is None else arguments.depth_scale
    return Pictures([(str(row), partial(np.asarray, camera.color[row])) for row in rows], camera.intrinsics, scale)


def board_pose(x: float, y: float, z: float, yaw_deg: float) -> NDArray[np.float64]:
    """Pose of a board that lies face up, (4, 4), [m]."""
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def read_poses(path: Path) -> dict[str, NDArray[np.float64]]:
    """A table of poses in base, by picture, (4, 4) each, [m].

    Raises:
        StorageError: If there is no such file.
        FormatError: If it is no such table.
    """
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except OSError as error:
        raise StorageError(f"cannot read {path}: {error.strerror}") from error
    poses = {}
    for line, row in enumerate(rows, start=2):
        try:
            x, y, z, *quat_xyzw = (float(row[column]) for column in COLUMNS[1:])
            poses[row["picture"]] = _pose((x, y, z), np.array(quat_xyzw))
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(f"{path}, line {line}: a pose is {','.join(COLUMNS)}: {error}") from error
    return poses


def _pose(position: tuple[float, float, float], quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    norm = np.linalg.norm(quat_xyzw)
    if not abs(norm - 1.0) < 0.01:
        raise ValueError(f"quat_xyzw {quat_xyzw.tolist()} has norm {norm:.3g}, not 1")
    vector, w = quat_xyzw[:3] / norm, quat_xyzw[3] / norm
    angle, length = 2.0 * math.atan2(float(np.linalg.norm(vector)), float(w)), max(float(np.linalg.norm(vector)), 1e-12)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(angle / length * vector)[0], position
    return T


def _read(file: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise FormatError(f"{file} is no picture that can be read")
    return np.asarray(image, np.uint8)
