"""Where a camera is, from pictures of a board whose place is known, or which the gripper holds."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.detector import TagDetector
from collectors.apriltags.layout import Layout
from collectors.apriltags.pose import fit, project, readings, reprojection_error
from svfl_data.errors import CollectError

TRIED = 5  # beginnings of a fit: one tag, or one picture, may be read the wrong way
LEAST_VIEWS = 3  # of a board in the gripper
LEAST_TURN = 0.1  # [rad] of the gripper about a second axis; below it the camera's place is badly determined


@dataclass(frozen=True)
class View:
    """The board in one picture.

    Attributes:
        name: Of the picture.
        points: Corners of the tags in the board's axes, (M, 3), [m].
        pixels: Where they are seen, (M, 2), [px].
        T_camera_board: As this picture alone tells, (4, 4), [m].
    """

    name: str
    points: NDArray[np.float64]
    pixels: NDArray[np.float64]
    T_camera_board: NDArray[np.float64]


@dataclass(frozen=True)
class Extrinsics:
    """Where the camera is, and how well that is known.

    Attributes:
        T_base_camera: Its pose, (4, 4), [m].
        errors: Root mean square reprojection error of each picture, [px].
        position_deviation: Standard deviation of its place that these errors mean, along base x, y, z, (3,), [m].
        rotation_deviation: That of its rotation about its own x, y, z, (3,), [rad].
        T_gripper_board: Where the board is on the gripper, if it holds it, (4, 4), [m].
    """

    T_base_camera: NDArray[np.float64]
    errors: dict[str, float]
    position_deviation: NDArray[np.float64]
    rotation_deviation: NDArray[np.float64]
    T_gripper_board: NDArray[np.float64] | None = None

    @property
    def error(self) -> float:
        """Root mean square over the pictures, [px]."""
        return float(np.sqrt(np.mean(np.square(list(self.errors.values())))))


def view(
    name: str, picture: NDArray[np.uint8], board: Layout, intrinsics: NDArray[np.float64], detector: TagDetector
) -> View | None:
    """Look for the board in a picture; None if it is not there.

    Args:
        name: Of the picture.
        picture: (H, W, 3) RGB or (H, W) grey, uint8, without lens distortion.
        board: Its tags.
        intrinsics: Pinhole matrix, (3, 3), [px].
        detector: For its family.
    """
    found = [one for one in detector(picture) if one.id in board.tags]
    if not found:
        return None
    points = np.concatenate([board.tags[one.id].corners for one in found])
    pixels = np.concatenate([one.corners for one in found])

    def error(T: NDArray[np.float64]) -> float:
        return reprojection_error(T, points, pixels, intrinsics)

    # Each tag is read in two ways, one of which is wrong; which ones agree best with all others is tried.
    tags = [(one, board.tags[one.id]) for one in found]
    starts = [T @ np.linalg.inv(tag.T_body_tag) for one, tag in tags for T in readings(one, tag.size, intrinsics)]
    fits = [fit(start, points, pixels, intrinsics) for start in sorted(starts, key=error)[:TRIED]]
    return View(name, points, pixels, min(fits, key=error))


def from_known_board(
    views: list[View], T_base_board: list[NDArray[np.float64]], intrinsics: NDArray[np.float64]
) -> Extrinsics:
    """The camera's pose from a board whose pose is known in each picture (the same one in all, or not).

    Args:
        views: The board in the pictures.
        T_base_board: Its pose in each, (4, 4), [m].
        intrinsics: Pinhole matrix, (3, 3), [px].
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
    """The camera's pose from a board that the gripper holds anyhow, but the same way in all pictures (eye-to-hand).

    Two poses are unknown, T_base_camera and T_gripper_board. Begun with the closed form for A Y = X B of Shah ("Solving
    the robot-world/hand-eye calibration problem using the Kronecker product", J. Mechanisms Robotics 2013), then least
    squares on all corners in all pictures.

    Args:
        views: The board in the pictures.
        T_base_gripper: Pose of the gripper in each, (4, 4), [m].
        intrinsics: Pinhole matrix, (3, 3), [px].

    Raises:
        CollectError: If there are fewer than `LEAST_VIEWS`, or the gripper has turned about less than two axes.
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
            f"hand-held board: in the {len(views)} usable pictures the gripper has not turned about two axes (spread "
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
    """X and Y of A Y = X B: rotations from the null space, then places from linear equations."""
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
    """The rotation nearest to a matrix."""
    u, _, v = np.linalg.svd(M)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def _moved(T: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose moved by x, y, z [m] in its parent's axes and turned by a rotation vector [rad] in its own."""
    moved = T.copy()
    moved[:3, 3] += change[:3]
    moved[:3, :3] = T[:3, :3] @ cv2.Rodrigues(change[3:])[0]
    return moved


def _deviation(
    off: Callable[[NDArray[np.float64]], NDArray[np.float64]], size: int, names: list[str]
) -> NDArray[np.float64]:
    """Standard deviation of each unknown at 0 that residuals mean, if corners are independent of each other.

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
