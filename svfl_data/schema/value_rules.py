"""Rules that the numbers of some standard fields must obey beyond their bounds: poses, matrices, quaternions, bounds.

`svfl_data.schema.validity` applies them.
"""

import functools
import re
from collections.abc import Callable

import numpy as np

from svfl_data.schema.fields import CAMERA

UNIT = 1e-3
"""Largest rounding error of the norm of a quaternion, and of each element of the product of a rotation with its
transpose."""
SHORTEST_FOCAL_PX = 1.0
NARROWEST_M = 1e-3
"""Smallest width of a workspace along each axis, [m]."""
CAMERA_PATH = re.compile(r"^cameras/[^/]+/")

Rule = Callable[[np.ndarray, int], str | None]
"""A function of a block of rows and the number of its first row. It returns what is wrong with the block, or None."""


@functools.lru_cache(maxsize=1024)
def rule_of(path: str) -> Rule | None:
    """Return the rule of a field; None if it has none.

    Args:
        path: Dataset path of the field.
    """
    return RULES.get(CAMERA_PATH.sub(f"cameras/{CAMERA}/", path))


def _no_poses(matrices: np.ndarray, first: int) -> str | None:
    wrong = (row for row, matrix in enumerate(matrices) if _no_pose(matrix, first))
    row = next(wrong, None)
    return None if row is None else f"holds no pose at index ({row + first},): its rotation or its last row is off"


def _no_pose(matrix: np.ndarray, first: int) -> str | None:
    rotation = matrix[:3, :3]
    rigid = _orthogonal(rotation) and np.linalg.det(rotation) > 0
    if rigid and np.allclose(matrix[3], [0, 0, 0, 1], atol=UNIT):
        return None
    return "is not a pose: its rotation or its last row is off"


def _not_orthogonal(matrix: np.ndarray, first: int) -> str | None:
    return None if _orthogonal(matrix) else "is not an orthogonal matrix"


def _orthogonal(matrix: np.ndarray) -> bool:
    return bool(np.allclose(matrix @ matrix.T, np.eye(len(matrix)), atol=UNIT))


def _no_pinhole(matrix: np.ndarray, first: int) -> str | None:
    focal = np.diag(matrix)[:2]
    if (focal < SHORTEST_FOCAL_PX).any():
        return f"has focal lengths {focal.tolist()} px; possible are {SHORTEST_FOCAL_PX:g} px and more"
    below = (matrix[1, 0], *matrix[2])
    return None if np.allclose(below, (0, 0, 0, 1), atol=UNIT) else "is not a pinhole matrix [fx s cx; 0 fy cy; 0 0 1]"


def _not_unit(poses: np.ndarray, first: int) -> str | None:
    norm = np.linalg.norm(poses[:, 3:], axis=1)
    if not len(rows := np.flatnonzero(np.abs(norm - 1) > UNIT)):
        return None
    return f"has a quat_xyzw of norm {norm[rows[0]]:.4g} at index ({rows[0] + first},); a rotation has norm 1"


def _no_room(bounds: np.ndarray, first: int) -> str | None:
    if not len(axes := np.flatnonzero(bounds[:, 1] - bounds[:, 0] < NARROWEST_M)):
        return None
    low, high = bounds[axes[0]]
    return f"is from {low:g} to {high:g} m at index ({axes[0]},): the lower bound must be below the upper bound"


RULES: dict[str, Rule] = {
    "streams/object/pose": _not_unit,
    "streams/tags/pose": _not_unit,
    "streams/tcp/pose": _not_unit,
    "cameras/{camera}/intrinsics": _no_pinhole,
    "cameras/{camera}/T_base_camera": _no_pose,
    "cameras/{camera}/T_base_camera_per_frame": _no_poses,
    "cameras/{camera}/T_tcp_camera": _no_pose,
    "cameras/{camera}/image_axes": _not_orthogonal,
    "workspace": _no_room,
}
"""Rule of each field that has one, by path."""
