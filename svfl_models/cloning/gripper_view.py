"""The camera's picture with the gripper in its middle: what a policy sees is where things are from the gripper.

Actions are displacements of the gripper, so a scene that is shifted together with the gripper asks for the same action,
and a scene that is turned about the gripper for the turned one. A picture of the whole table leaves a policy to find
the gripper in it first; one around the gripper has both symmetries in its frame. The middle is the point of the table
below the TCP, projected through the camera's calibration, so what lies under the gripper is in the middle at whatever
height.

The paper crops about the middle of the workspace; `docs/cloning.md` has both.
"""

import numpy as np
import torch
from torch import Tensor

JITTER = 1
"""Pixels by which training crops are off at random."""


def projection(intrinsics: np.ndarray, T_base_camera: np.ndarray) -> np.ndarray:
    """Matrix (3, 4) that takes a homogeneous point in base axes, [m], to homogeneous pixels (column, row).

    Args:
        intrinsics: Pinhole matrix K, (3, 3), [px].
        T_base_camera: Pose of the camera, (4, 4), [m]; camera axes x right, y down, z forward.
    """
    return np.asarray(intrinsics @ np.linalg.inv(T_base_camera)[:3])


def corners(proprio: Tensor, matrix: Tensor, table: float, height: int, side: int) -> Tensor:
    """Where to cut: (row, column) of the first pixel, (B, 2), int64; beyond the edges by at most a whole crop.

    Args:
        proprio: Base axes: opening, TCP x, y, z [m], yaw, shape (B, 5).
        matrix: See `projection`.
        table: Height of the table in base axes, [m].
        height: Of the picture, which is square, [px].
        side: Of the crop, [px].
    """
    ones = torch.ones_like(proprio[:, :1])
    point = torch.cat([proprio[:, 1:3], table * ones, ones], dim=1) @ matrix.T  # (B, 3)
    pixel = point[:, :2] / point[:, 2:].clamp(min=1e-6)
    corner = torch.round(pixel.flip(1) - (side - 1) / 2)
    return corner.clamp(-side, height).to(torch.int64)
