"""Pose of a camera from pictures of a board of tags whose pose is known, or which the gripper holds."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.detector import TagDetector
from collectors.apriltags.layout import Layout
from collectors.apriltags.pose import fit, project, readings, reprojection_error
from svfl_data.errors import CollectError

TRIED = 5  # start poses that a fit is tried from, since a single tag or picture may give the wrong one of two poses
LEAST_VIEWS = 3  # pictures that a board in the gripper must be seen in
LEAST_TURN = 0.1  # [rad] least rotation of the gripper about a second axis that determines the camera's position well


@dataclass(frozen=True)
class View:
    """View of the board in one picture.

    Attributes:
        name: Name of the picture.
        points: Corners of the tags in the board's axes, (M, 3), [m].
        pixels: Positions of these corners in the picture, (M, 2), [px].
        T_camera_board: Pose of the board in the camera's axes, as this picture alone gives it, (4, 4), [m].
    """

    name: str
    points: NDArray[np.float64]
    pixels: NDArray[np.float64]
    T_camera_board: NDArray[np.float64]


@dataclass(frozen=True)
class Extrinsics:
    """Pose of a camera in base, and its uncertainty.

    Attributes:
        T_base_camera: Pose of the camera in base, (4, 4), [m].
        errors: Root mean square reprojection error of each picture, [px].
        position_deviation: Standard deviation of the camera's position that follows from these errors, along base x, y,
            z, (3,), [m].
        rotation_deviation: Standard deviation of the camera's rotation about its own x, y, z axes, (3,), [rad].
        T_gripper_board: Pose of the board in the gripper's axes if the gripper holds the board, (4, 4), [m]; otherwise
            None.
    """

    T_base_camera: NDArray[np.float64]
    errors: dict[str, float]
    position_deviation: NDArray[np.float64]
    rotation_deviation: NDArray[np.float64]
    T_gripper_board: NDArray[np.float64] | None = None

    @property
    def error(self) -> float:
        """Root mean square of the pictures' reprojection errors, [px]."""
        return float(np.sqrt(np.mean(np.square(list(self.errors.values())))))


def view(
    name: str, picture: NDArray[np.uint8], board: Layout, intrinsics: NDArray[np.float64], detector: TagDetector
) -> View | None:
    """Find the board in a picture.

    Args:
        name: Name of the picture.
        picture: Picture without lens distortion, (H, W, 3) RGB or (H, W) grey, uint8.
        board: Layout of the board's tags.
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].
        detector: Detector for the tag family of the board.

    Returns:
        The view of the board, or None if none of its tags is found in the picture.
    """
    found = [one for one in detector(picture) if one.id in board.tags]
    if not found:
        return None
    points = np.concatenate([board.tags[one.id].corners for one in found])
    pixels = np.concatenate([one.corners for one in found])

    def error(T: NDArray[np.float64]) -> float:
        return reprojection_error(T, points, pixels, intrinsics)

    # Each tag has two possible poses, one of which is wrong; the fits that agree best with all tags are tried.
    tags = [(one, board.tags[one.id]) for one in found]
    starts = [T @ np.linalg.inv(tag.T_body_tag) for one, tag in tags for T in readings(one, tag.size, intrinsics)]
    fits = [fit(start, points, pixels, intrinsics) for start in sorted(starts, key=error)[:TRIED]]
    return View(name, points, pixels, min(fits, key=error))


def from_known_board(
    views: list[View], T_base_board: list[NDArray[np.float64]], intrinsics: NDArray[np.float64]
) -> Extrinsics:
    """Return the camera's pose from a board whose pose in base is known for each picture.

    The board may lie still or be moved between the pictures.

    Args:
        views: Views of the board, one for each picture.
        T_base_board: Pose of the board in base for each view, (4, 4), [m].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].

    Raises:
        CollectError: If the pictures do not determine the camera's pose.
    """
    points = [one.points @ T[:3, :3].T + T[:3, 3] for one, T in zip(views, T_base_board, strict=True)]
    pixels = np.concatenate([one.pixels for one in views])
    starts = [one.T_camera_board @ np.linalg.inv(T) for one, T in zip(views, T_base_board, strict=True)]
    every = np.concatenate(points)
    fits = [fit(start, every, pixels, intrinsics) for start in starts[:TRIED]]
    T = min(fits, key=lambda T: reprojection_error(T, every, pixels, intrinsics))
    errors = {
        one.name: reprojection_error(T, own, one.pixels, intrinsics) for one, own in zip(views, points, strict=True)
    }
    camera = np.linalg.inv(T).astype(np.float64)

    def off(change: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = np.linalg.inv(_moved(camera, change)).astype(np.float64)
        return (project(moved, every, intrinsics) - pixels).ravel()

    deviation = _deviation(off, 6, [one.name for one in views])
    return Extrinsics(camera, errors, deviation[:3], deviation[3:6])


def from_gripper_held_board(
    views: list[View], T_base_gripper: list[NDArray[np.float64]], intrinsics: NDArray[np.float64]
) -> Extrinsics:
    """Return the camera's pose from a board that the gripper holds (eye-to-hand calibration).

    The pose of the board in the gripper need not be known, but must be the same in all pictures. Two poses are unknown,
    T_base_camera and T_gripper_board. The fit starts from the closed form for A Y = X B of Shah ("Solving the
    robot-world/hand-eye calibration problem using the Kronecker product", J. Mechanisms Robotics 2013), then minimizes
    the squared errors of all corners in all pictures.

    Args:
        views: Views of the board, one for each picture.
        T_base_gripper: Pose of the gripper in base for each view, (4, 4), [m].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].

    Raises:
        CollectError: If there are fewer than `LEAST_VIEWS` views, the gripper has rotated about less than two axes, or
            the pictures do not determine the camera's pose.
    """
    from scipy.optimize import least_squares

    if len(views) < LEAST_VIEWS:
        raise CollectError(
            f"hand-held board: it is seen in {len(views)} of the pictures; {LEAST_VIEWS} are needed, better 8 or more"
        )
    turns = np.array([cv2.Rodrigues(T[:3, :3] @ T_base_gripper[0][:3, :3].T)[0][:, 0] for T in T_base_gripper])
    spread = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(turns))
    if spread[1] < LEAST_TURN:
        raise CollectError(
            f"hand-held board: in the {len(views)} usable pictures the gripper has not rotated about two axes (spread "
            f"about the second {np.degrees(spread[1]):.1f} deg, needed {np.degrees(LEAST_TURN):.1f} deg); "
            "tilt it, or lay the board on the table and use --board-pose"
        )
    X, Y = _closed_form(T_base_gripper, [one.T_camera_board for one in views])

    def off(change: NDArray[np.float64]) -> NDArray[np.float64]:
        camera, board = np.linalg.inv(_moved(X, change[:6])), _moved(Y, change[6:])
        return np.concatenate(
            [
                (project(camera @ gripper @ board, one.points, intrinsics) - one.pixels).ravel()
                for one, gripper in zip(views, T_base_gripper, strict=True)
            ]
        )

    found = least_squares(off, np.zeros(12), loss="huber", f_scale=1.0, x_scale="jac")
    X, Y = _moved(X, found.x[:6]), _moved(Y, found.x[6:])
    deviation = _deviation(off, 12, [one.name for one in views])
    errors = {
        one.name: reprojection_error(np.linalg.inv(X) @ gripper @ Y, one.points, one.pixels, intrinsics)
        for one, gripper in zip(views, T_base_gripper, strict=True)
    }
    return Extrinsics(X, errors, deviation[:3], deviation[3:6], Y)


def _closed_form(
    A: list[NDArray[np.float64]], B: list[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solve A Y = X B for X and Y: rotations from the null space, then positions from linear equations."""
    rows = [
        np.hstack([np.kron(np.eye(3), a[:3, :3]), -np.kron(b[:3, :3].T, np.eye(3))]) for a, b in zip(A, B, strict=True)
    ]
    null = np.linalg.svd(np.concatenate(rows))[2][-1]  # vec(R_Y), vec(R_X), column by column
    null *= np.sign(np.linalg.det(null[:9].reshape(3, 3)))
    X, Y = np.eye(4), np.eye(4)
    Y[:3, :3], X[:3, :3] = (_rotation(part.reshape(3, 3).T) for part in (null[:9], null[9:]))
    places = np.concatenate([np.hstack([a[:3, :3], -np.eye(3)]) for a in A])
    wanted = np.concatenate([X[:3, :3] @ b[:3, 3] - a[:3, 3] for a, b in zip(A, B, strict=True)])
    solved = np.linalg.lstsq(places, wanted, rcond=None)[0]
    Y[:3, 3], X[:3, 3] = solved[:3], solved[3:]
    return X, Y


def _rotation(M: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation that is nearest to a matrix, (3, 3)."""
    u, _, v = np.linalg.svd(M)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def _moved(T: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a pose moved by x, y, z [m] in its parent's axes and turned by a rotation vector [rad] in its own axes."""
    moved = T.copy()
    moved[:3, 3] += change[:3]
    moved[:3, :3] = T[:3, :3] @ cv2.Rodrigues(change[3:])[0]
    return moved


def _deviation(
    off: Callable[[NDArray[np.float64]], NDArray[np.float64]], size: int, names: list[str]
) -> NDArray[np.float64]:
    """Return the standard deviation of each unknown at 0, from residuals whose corners are taken as independent.

    Raises:
        CollectError: If the pictures do not determine the unknowns.
    """
    residuals, nudge = off(np.zeros(size)), 1e-6
    J = np.stack([(off(nudge * one) - off(-nudge * one)) / (2 * nudge) for one in np.eye(size)], axis=1)
    free = max(len(residuals) - size, 1)
    try:
        covariance = np.linalg.inv(J.T @ J) * (residuals @ residuals) / free
    except np.linalg.LinAlgError as error:
        raise CollectError(f"the pictures {', '.join(names)} do not determine the camera's pose") from error
    return np.sqrt(np.abs(np.diag(covariance)))
