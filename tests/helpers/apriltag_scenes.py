"""Pictures of tags with a known truth: a printed page seen by a camera, without a renderer."""

import cv2
import numpy as np

from collectors.apriltags.print_files import picture
from collectors.apriltags.print_layout import board_page, cell_mm
from collectors.simulation.camera import CameraConfig, calibration

DPI = 200
COLUMNS, ROWS, SIZE_MM = 4, 3, 30.0


def camera(eye, target=(0.55, 0.0, 0.0), fov_deg=45.0):
    """Calibration of a 640 x 480 camera that looks from `eye` at `target`, base, [m]."""
    return calibration(CameraConfig(480, 640, eye, target, (-1.0, 0.1, 0.0), fov_deg))


def board_picture(T_camera_board, intrinsics, noise=2.0, seed=0):
    """What a camera sees of the board, (480, 640) uint8, on a grey table."""
    page = board_page("tag36h11", COLUMNS, ROWS, SIZE_MM, 0, "a4")
    cell = cell_mm("tag36h11", SIZE_MM)
    scale = DPI / 25.4
    left, bottom = (page.width - COLUMNS * cell) / 2 * scale, (20.0 + ROWS * cell) * scale
    # Page pixels to the board's axes [m] on its plane, then to the camera's pixels; pixel centres are whole numbers.
    metre = 1e-3 / scale
    board = np.array([[metre, 0.0, (0.5 - left) * metre], [0.0, -metre, (bottom - 0.5) * metre], [0.0, 0.0, 1.0]])
    H = intrinsics @ T_camera_board[:3, [0, 1, 3]] @ board
    printed = picture(page, DPI).astype(np.float32)
    fine = 3
    up = np.array([[fine, 0.0, (fine - 1) / 2], [0.0, fine, (fine - 1) / 2], [0.0, 0.0, 1.0]])
    size = (640 * fine, 480 * fine)
    seen = cv2.warpPerspective(
        printed, up @ H, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=130
    )
    seen = cv2.resize(seen, (640, 480), interpolation=cv2.INTER_AREA)
    noisy = 0.8 * seen + 20 + np.random.default_rng(seed).normal(0.0, noise, seen.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)
