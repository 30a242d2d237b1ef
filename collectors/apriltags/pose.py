"""Pose of a body from the corners of its tags, by a joint fit to all corners that starts from each tag's two poses."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.detector import Detection
from collectors.apriltags.layout import CORNERS, Layout

FACING = 0.6  # least `Detection.facing` of a tag that is used, unless all tags are more slanted
ROUNDS = 15  # largest number of rounds of the fit, which ends earlier when the pose no longer changes
STILL = 1e-8  # [m] and [rad] change of the pose in one round, below which the fit ends
OUTLIER_PX = 1.0  # error from which a corner's influence is constant (Huber), as for one at the edge of an occlusion
ALIKE = 2.0  # poses whose error is at most this many times the smallest error count as equally good
DOUBT = 1.0  # [px] reprojection error above which a smaller set of tags is tried
CORNER_PX = 0.2  # [px] standard deviation of a corner, against which a known tilt is weighed
TILT = 0.005  # [rad] standard deviation of the tilt of an upright body


@dataclass(frozen=True)
class BodyPose:
    """Pose of a body, as found in one picture.

    Attributes:
        T_camera_body: Pose of the body in the camera's axes, (4, 4), [m].
        error: Root mean square distance of the tags' corners in the picture from where this pose predicts them, [px].
        margin: Smallest decision margin of the tags that were used, in grey levels.
        tags: Ids of the tags that were used.
    """

    T_camera_body: NDArray[np.float64]
    error: float
    margin: float
    tags: tuple[int, ...]


def readings(detection: Detection, size: float, intrinsics: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return both poses that explain the corners of a tag, since a small square looks nearly the same for two tilts.

    The first pose follows from the homography of the corners. The second pose is the first one turned by half a turn
    about the line of sight, and back about the tag's own normal, which mirrors the tilt (Schweighofer and Pinz, "Robust
    pose estimation from a planar target", PAMI 2006). Neither pose is refined yet. OpenCV's IPPE_SQUARE is not used
    because it would be NaN or wrong for a tag that squarely faces the camera.

    Args:
        detection: Detection of the tag.
        size: Size of the tag, [m].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].

    Returns:
        The two poses T_camera_tag, (4, 4) each, [m].
    """
    flat = (size * CORNERS[:, :2]).astype(np.float32)
    H = np.linalg.inv(intrinsics) @ cv2.getPerspectiveTransform(flat, detection.corners.astype(np.float32))
    H *= np.sign(H[2, 2]) * 2.0 / (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1]))
    u, _, v = np.linalg.svd(np.column_stack([H[:, :2], np.cross(H[:, 0], H[:, 1])]))
    first, second = np.eye(4), np.eye(4)
    first[:3, :3], first[:3, 3] = u @ v, H[:, 2]
    sight = H[:, 2] / np.linalg.norm(H[:, 2])
    half_turn = 2.0 * np.outer(sight, sight) - np.eye(3)
    second[:3, :3], second[:3, 3] = half_turn @ first[:3, :3] @ np.diag([-1.0, -1.0, 1.0]), H[:, 2]
    return [first, second]


def body_pose(
    detections: list[Detection],
    layout: Layout,
    intrinsics: NDArray[np.float64],
    up: NDArray[np.float64] | None = None,
) -> BodyPose | None:
    """Return the pose that explains all corners of a body's tags best.

    Args:
        detections: Tags found in the picture; tags of other bodies are ignored.
        layout: Layout of the tags on the body.
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].
        up: Upward direction in camera axes, (3,), for a body that is known to stand upright, such as one that lies on a
            table. It then decides between poses that explain the corners equally well, and the tilt, which corners
            determine badly, is held near upright. None if the body may be tilted.

    Returns:
        The pose, or None if none of the body's tags were found.
    """
    own = [one for one in detections if one.family == layout.family and one.id in layout.tags]
    if not own:
        return None
    most = max(one.facing for one in own)
    own = [one for one in own if one.facing >= min(FACING, most)]
    best = _joint(own, layout, intrinsics, up)
    while best.error > DOUBT and len(own) > 1:  # a tag whose corner is covered spoils the others
        trials = [[other for other in own if other is not one] for one in own]
        best, own = min(
            ((_joint(some, layout, intrinsics, up), some) for some in trials), key=lambda trial: trial[0].error
        )
    return best


def _joint(
    own: list[Detection], layout: Layout, intrinsics: NDArray[np.float64], up: NDArray[np.float64] | None
) -> BodyPose:
    """Return the pose that explains all corners of these tags best, starting from both poses of each tag."""
    points = np.concatenate([layout.tags[one.id].corners for one in own])
    pixels = np.concatenate([one.corners for one in own])
    fits = []
    for one in own:
        tag = layout.tags[one.id]
        for T_camera_tag in readings(one, tag.size, intrinsics):
            T = fit(T_camera_tag @ np.linalg.inv(tag.T_body_tag), points, pixels, intrinsics, up)
            fits.append((reprojection_error(T, points, pixels, intrinsics), T))
    least = min(error for error, _ in fits)
    alike = [fit for fit in fits if fit[0] <= ALIKE * least]
    error, T = min(alike, key=lambda fit: fit[0] if up is None else -float(fit[1][:3, 2] @ up))
    return BodyPose(T, error, min(one.margin for one in own), tuple(one.id for one in own))


def fit(
    start: NDArray[np.float64],
    points: NDArray[np.float64],
    pixels: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    up: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Move a pose until the body's points lie where they are seen in the picture (Gauss-Newton on Huber's loss).

    Args:
        start: T_camera_body that the fit starts from, (4, 4), [m].
        points: Points in the body's axes, (M, 3), [m].
        pixels: Positions of these points in the picture, (M, 2), [px].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].
        up: Direction of the body's z axis in camera axes, (3,), or None if the body may be tilted.

    Returns:
        The fitted T_camera_body, (4, 4), [m].
    """
    T = start.copy()
    for _ in range(ROUNDS):
        off = project(T, points, intrinsics) - pixels
        pull = np.sqrt(np.minimum(1.0, OUTLIER_PX / np.maximum(np.linalg.norm(off, axis=1), 1e-12)))
        A, b = (pull[:, None, None] * jacobian(T, points, intrinsics)).reshape(-1, 6), (pull[:, None] * off).ravel()
        before, T = T, turned_by(T, A, -b, up)
        if np.abs(T - before).max() < STILL or not np.isfinite(T).all():
            break
    return T


def jacobian(
    T: NDArray[np.float64], points: NDArray[np.float64], intrinsics: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the derivative of a body's projected points by the body's turn and shift.

    The turn is about the camera's axes through the body's origin; the shift is along the camera's axes.

    Args:
        T: T_camera_body, (4, 4), [m].
        points: Points in the body's axes, (M, 3), [m].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].

    Returns:
        The derivative d(x, y)/d(turn, shift), (M, 2, 6), [px/rad] and [px/m].
    """
    turned = points @ T[:3, :3].T
    x, y, z = (turned + T[:3, 3]).T
    zero = np.zeros_like(z)
    ray = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], 1)
    moves = np.concatenate([-_cross(turned), np.broadcast_to(np.eye(3), (len(z), 3, 3))], axis=2)
    return np.asarray(intrinsics[:2, :2] @ ray @ moves)


def turned_by(
    T: NDArray[np.float64], A: NDArray[np.float64], b: NDArray[np.float64], up: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the pose after the step (turn, shift) that solves A step = b in the sense of least squares.

    Args:
        T: T_camera_body before the step, (4, 4), [m].
        A: Derivative of the residuals by the step, (M, 6), [px/rad] and [px/m].
        b: Change of the residuals that the step shall cause, (M,), [px].
        up: Direction of the body's z axis in camera axes, (3,), or None if the body may be tilted. The tilt is weighed
            like a measurement with standard deviation `TILT` beside pixels of standard deviation `CORNER_PX`.
    """
    if up is not None:
        across = _across(up)
        tilt = np.concatenate([-across @ _cross(T[None, :3, 2])[0], np.zeros((2, 3))], axis=1)
        A = np.concatenate([A, CORNER_PX / TILT * tilt])
        b = np.concatenate([b, -CORNER_PX / TILT * (across @ T[:3, 2])])
    step = np.linalg.lstsq(A, b, rcond=None)[0]
    moved = T.copy()
    moved[:3, :3] = cv2.Rodrigues(step[:3])[0] @ T[:3, :3]
    moved[:3, 3] += step[3:]
    return moved


def project(
    T: NDArray[np.float64], points: NDArray[np.float64], intrinsics: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the positions in the picture of points of a body, (M, 2), [px].

    Args:
        T: T_camera_body, (4, 4), [m].
        points: Points in the body's axes, (M, 3), [m].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].
    """
    seen = (points @ T[:3, :3].T + T[:3, 3]) @ intrinsics.T
    pixels: NDArray[np.float64] = seen[:, :2] / seen[:, 2:]
    return pixels


def reprojection_error(
    T: NDArray[np.float64], points: NDArray[np.float64], pixels: NDArray[np.float64], intrinsics: NDArray[np.float64]
) -> float:
    """Return the root mean square distance of points in the picture from where a pose predicts them, [px].

    Args:
        T: T_camera_body, (4, 4), [m].
        points: Points in the body's axes, (M, 3), [m].
        pixels: Positions of these points in the picture, (M, 2), [px].
        intrinsics: Pinhole matrix of the camera, (3, 3), [px].
    """
    off = project(T, points, intrinsics) - pixels
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _cross(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix of the cross product with each vector, (M, 3) to (M, 3, 3)."""
    x, y, z = vectors.T
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], axis=1)


def _across(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two unit vectors at right angles to a direction and to each other, (2, 3)."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:])
