"""Calibration file: a JSON file, readable by people, with intrinsics and poses of real cameras."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.errors import FormatError, StorageError
from svfl_data.schema.robot import Calibration
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.side_files import read_json


def read_calibrations(path: Path) -> dict[str, Calibration]:
    """Read the cameras of a calibration file.

    Args:
        path: Calibration file.

    Returns:
        The calibration of each camera, by the camera's name.

    Raises:
        StorageError: If the file does not exist or cannot be read.
        FormatError: If the file is not a calibration file, or a camera in it is incomplete.
    """
    shapes = {"intrinsics": (3, 3), "T_base_camera": (4, 4), "image_axes": (2, 2)}
    cameras = {}
    for name, values in _cameras(path).items():
        try:
            arrays = {field: np.array(values[field], np.float64).reshape(shape) for field, shape in shapes.items()}
            cameras[name] = Calibration(**arrays, depth_scale=float(values["depth_scale"]))
        except (KeyError, ValueError, TypeError) as error:
            needs = ", ".join([*shapes, "depth_scale"])
            raise FormatError(f"{path}: camera {name!r} needs {needs}: {type(error).__name__}: {error}") from error
    return cameras


def write_calibration(path: Path, name: str, calibration: Calibration, residuals: dict[str, Any]) -> None:
    """Write a camera into a calibration file; other cameras that the file holds are kept.

    Args:
        path: Calibration file, which is created if it does not exist.
        name: Name of the camera. A camera of this name in the file is replaced.
        calibration: Calibration of the camera.
        residuals: Residuals that say how well the calibration fits the pictures, JSON values.

    Raises:
        StorageError: If the file cannot be written.
        FormatError: If the file exists and is not a calibration file.
    """
    cameras = _cameras(path) if path.exists() else {}
    cameras[name] = {
        "intrinsics": calibration.intrinsics.tolist(),
        "T_base_camera": calibration.T_base_camera.tolist(),
        "image_axes": calibration.image_axes.tolist(),
        "depth_scale": calibration.depth_scale,
        "residuals": residuals,
    }
    content = json.dumps({"format": "svfl-calibration", "cameras": cameras}, indent=1) + "\n"
    write_atomically(path, content.encode())  # the other cameras survive a full disk


def _cameras(path: Path) -> dict[str, Any]:
    try:
        found = read_json(path)
        if found["format"] != "svfl-calibration":
            raise ValueError(f"format {found['format']!r}")
        return dict(found["cameras"])
    except OSError as error:
        raise StorageError(f"cannot read {path}: {error.strerror}") from error
    except (FormatError, ValueError, KeyError, TypeError) as error:
        why = f"{type(error).__name__}: {error}"
        raise FormatError(f"{path} is no calibration file of svfl-collect calibrate: {why}") from error
