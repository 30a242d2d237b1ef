"""Input of a calibration: pictures from a folder or an episode, and poses from a table."""

import argparse
import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import FormatError, StorageError, UsageError

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
FRAMES = 50  # largest number of frames of an episode that are used, since more similar frames add no information
FOCAL = (0.2, 20.0)  # bounds of a focal length relative to the picture's width: fields of view of 137 to 3 degrees
COLUMNS = ("picture", "x", "y", "z", "qx", "qy", "qz", "qw")
DEPTH_SCALE = 0.001  # [m] per unit of depth, as most depth cameras have it


@dataclass(frozen=True)
class Pictures:
    """Pictures of one camera, which all have the same size.

    Attributes:
        pictures: Name of each picture, and a function that reads the picture, (H, W) or (H, W, 3) uint8.
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].
        depth_scale: Metres per unit of depth, [m].
    """

    pictures: list[tuple[str, Callable[[], NDArray[np.uint8]]]]
    intrinsics: NDArray[np.float64]
    depth_scale: float

    def checked(self) -> Iterator[tuple[str, NDArray[np.uint8]]]:
        """Read the pictures one at a time and check that their size matches the intrinsics.

        Yields:
            The name of each picture, and the picture, (H, W) or (H, W, 3) uint8.

        Raises:
            UsageError: If the intrinsics cannot be those of pictures of this size, or the sizes of the pictures differ.
            FormatError: If a file cannot be read as a picture.
        """
        (fx, _, cx), (_, fy, cy), _ = self.intrinsics
        first = None
        for name, read in self.pictures:
            picture = read()
            height, width = picture.shape[:2]
            first = first or (width, height)
            if (width, height) != first:
                raise UsageError(
                    f"{name} has {width} x {height} px, {self.pictures[0][0]} {first[0]} x {first[1]}: "
                    "pictures of one camera have one size"
                )
            focal = FOCAL[0] * width < min(fx, fy) <= max(fx, fy) < FOCAL[1] * width
            if not (focal and 0 < cx < width - 1 and 0 < cy < height - 1):
                raise UsageError(
                    f"intrinsics {fx:g},{fy:g},{cx:g},{cy:g} cannot be those of {name}, which has {width} x {height} "
                    "px; are they of another resolution?"
                )
            yield name, picture


def of_folder(arguments: argparse.Namespace) -> Pictures:
    """Return all pictures in the folder ``path``, sorted by file name.

    Args:
        arguments: Command-line arguments with ``path``, ``intrinsics`` and ``depth_scale``.

    Raises:
        UsageError: If the folder has no pictures, or ``--intrinsics`` is missing.
    """
    files = sorted(file for file in arguments.path.iterdir() if file.suffix.lower() in SUFFIXES)
    if not files:
        raise UsageError(f"{arguments.path}: no pictures there ({', '.join(SUFFIXES)})")
    if not arguments.intrinsics:
        raise UsageError(f"{arguments.path}: pictures in a folder need --intrinsics FX,FY,CX,CY")
    scale = DEPTH_SCALE if arguments.depth_scale is None else arguments.depth_scale
    return Pictures([(file.name, partial(_read, file)) for file in files], _matrix(*arguments.intrinsics), scale)


def of_episode(arguments: argparse.Namespace) -> Pictures:
    """Return at most `FRAMES` frames of the camera ``--camera`` of an episode, each named by its number in the episode.

    Args:
        arguments: Command-line arguments with ``path``, ``episode``, ``camera``, ``intrinsics`` and ``depth_scale``.
            The last two default to those of the episode.

    Raises:
        UsageError: If the episode has no such camera.
    """
    from svfl_data.commands.source import read

    episode = read(arguments.path, arguments.episode)
    if arguments.camera not in episode.cameras:
        raise UsageError(
            f"{episode.name}: no camera {arguments.camera!r}; its cameras are {', '.join(episode.cameras)}"
        )
    camera = episode.cameras[arguments.camera]
    rows = np.unique(np.linspace(0, len(camera.color) - 1, FRAMES).astype(int)).tolist()
    own = float(camera.depth_scale) if camera.has("depth_scale") else DEPTH_SCALE
    scale = own if arguments.depth_scale is None else arguments.depth_scale
    K = _matrix(*arguments.intrinsics) if arguments.intrinsics else camera.intrinsics
    return Pictures([(str(row), partial(np.asarray, camera.color[row])) for row in rows], K, scale)


def board_pose(x: float, y: float, z: float, yaw_deg: float) -> NDArray[np.float64]:
    """Return the pose in base of a board that lies face up, (4, 4), [m].

    Args:
        x: Position of the board's origin along base x, [m].
        y: Position of the board's origin along base y, [m].
        z: Position of the board's origin along base z, [m].
        yaw_deg: Rotation of the board about base z, [deg].
    """
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def read_poses(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read a CSV table of poses in base, with the columns `COLUMNS`.

    Args:
        path: CSV file to read.

    Returns:
        The pose for each picture, by the picture's name, (4, 4), [m].

    Raises:
        StorageError: If the file does not exist or cannot be read.
        FormatError: If the file is not such a table.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets begin with a byte order mark
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except OSError as error:
        raise StorageError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path} is no table of poses, {','.join(COLUMNS)}: {error}") from error
    if not rows:
        raise FormatError(f"{path} has no poses; it needs a line {','.join(COLUMNS)} and one for each picture")
    poses: dict[str, NDArray[np.float64]] = {}
    for line, row in enumerate(rows, start=2):
        if missing := [column for column in COLUMNS if row.get(column) is None]:
            raise FormatError(f"{path}, line {line}: a pose is {','.join(COLUMNS)}; there is no {missing[0]}")
        if row["picture"] in poses:
            raise FormatError(f"{path}, line {line}: a second pose for {row['picture']}")
        try:
            poses[row["picture"]] = _pose(np.array([float(row[column]) for column in COLUMNS[1:]]))
        except ValueError as error:
            raise FormatError(f"{path}, line {line}: a pose is {','.join(COLUMNS)}: {error}") from error
    return poses


def _matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _pose(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(pose).all():
        raise ValueError(f"{pose.tolist()} are not numbers")
    position, quat_xyzw = pose[:3], pose[3:]
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
