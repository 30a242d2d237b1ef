"""Crops camera images around the gripper, so that a policy sees positions relative to the gripper.

An action is a displacement of the gripper. If the scene is shifted together with the gripper, the right action stays
the same; if the scene is rotated about the gripper, the right action is rotated as well. In an image of the whole table
a policy must first find the gripper, whereas an image centred on the gripper shows both symmetries directly. The centre
of the image is the point of the table below the TCP, projected with the camera's calibration, so that what lies under
the gripper is in the centre whatever the height of the gripper.

The paper crops around the middle of the workspace; `docs/cloning.md` describes both.
"""

import numpy as np
import torch
from torch import Tensor

JITTER = 1
"""Largest random shift of a training crop along each axis, [px]."""


def projection(intrinsics: np.ndarray, T_base_camera: np.ndarray) -> np.ndarray:
    """Return the matrix (3, 4) from a homogeneous point in base axes, [m], to a homogeneous pixel (column, row).

    Args:
        intrinsics: Pinhole matrix K of the camera, shape (3, 3), [px].
        T_base_camera: Pose of the camera in base axes, shape (4, 4), [m]; camera axes are x right, y down, z forward.
    """
    return np.asarray(intrinsics @ np.linalg.inv(T_base_camera)[:3])


def corners(proprio: Tensor, matrix: Tensor, table: float, height: int, side: int) -> Tensor:
    """Return the (row, column) of each crop's first pixel, shape (B, 2), int64.

    A crop lies around the point of the table below the TCP, and beyond the edges of the image by at most its own side.

    Args:
        proprio: Gripper opening, TCP x, y, z [m] and yaw in base axes, shape (B, 5).
        matrix: Projection matrix of the camera, shape (3, 4), see `projection`.
        table: Height of the table in base axes, [m].
        height: Height and width of the image, [px].
        side: Height and width of the crop, [px].
    """
    ones = torch.ones_like(proprio[:, :1])
    point = torch.cat([proprio[:, 1:3], table * ones, ones], dim=1) @ matrix.T  # (B, 3)
    pixel = point[:, :2] / point[:, 2:].clamp(min=1e-6)
    corner = torch.round(pixel.flip(1) - (side - 1) / 2)
    return corner.clamp(-side, height).to(torch.int64)
