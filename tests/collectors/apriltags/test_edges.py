"""Edges bring a pose to where the tags are, to a fraction of a pixel, whatever part of them is covered."""

import cv2
import numpy as np
import pytest

from collectors.apriltags.edges import Edges
from collectors.apriltags.layout import Layout
from collectors.apriltags.picture import modules
from collectors.apriltags.pose import project
from collectors.apriltags.tracker import Limits

K = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])
HALF, FINE = 0.025, 3
CUBE = Layout.cube(HALF, 0.04)
UPSIDE = np.diag([1.0, -1.0, -1.0])  # of a body whose z is towards the camera


def turn(vector):
    return cv2.Rodrigues(np.array(vector, float))[0]


def pose(vector, place):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn(vector) @ UPSIDE, place
    return T


def painted(T, noise=3.0, seed=0, layout=CUBE):
    """The cube at T_camera_body on a grey table, (480, 640) uint8, without a renderer."""
    fine = np.full((480 * FINE, 640 * FINE), 130, np.uint8)
    for tag in layout.tags.values():
        R, middle = (T @ tag.T_body_tag)[:3, :3], (T @ tag.T_body_tag)[:3, 3]
        if R[:, 2] @ middle > 0:
            continue  # it looks away
        face = np.where(modules(layout.family, tag.id), 20, 220).astype(np.uint8)
        half = tag.size * face.shape[0] / 8 / 2
        square = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
        points = square @ tag.T_body_tag[:3, :3].T + tag.T_body_tag[:3, 3]
        pixels = FINE * (project(T, points, K) + 0.5) - 0.5
        side = face.shape[0] * 20
        corners = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - 0.5
        H = cv2.getPerspectiveTransform(corners, pixels.astype(np.float32))
        big = np.kron(face, np.ones((20, 20), np.uint8))
        size = (640 * FINE, 480 * FINE)
        inside = cv2.warpPerspective(np.full_like(big, 255), H, size, flags=cv2.INTER_NEAREST)
        fine = np.where(inside > 0, cv2.warpPerspective(big, H, size), fine)
    seen = cv2.resize(fine, (640, 480), interpolation=cv2.INTER_AREA)
    return np.clip(seen + np.random.default_rng(seed).normal(0, noise, seen.shape), 0, 255).astype(np.uint8)


def shaken(T, rng):
    """A pose whose corners are a few pixels off, mostly in distance and tilt, as those of a slanted tag."""
    off = T.copy()
    off[:3, :3] = turn(rng.normal(0, 0.04, 3)) @ T[:3, :3]
    off[:3, 3] *= 1 + 0.04 * rng.choice([-1, 1])
    off[:2, 3] += rng.normal(0, 1.0, 2) / 600 * T[2, 3]
    return off


def degrees_between(A, B):
    return np.degrees(np.linalg.norm(cv2.Rodrigues(A[:3, :3].T @ B[:3, :3])[0]))


VIEWS = [([0.5, 0.2, 0.4], [0.02, 0.01, 0.6]), ([-0.6, 0.3, 2.0], [-0.05, 0.03, 0.55]), ([0.1, 0.7, -1.0], [0, 0, 0.5])]


@pytest.mark.parametrize(("vector", "place"), VIEWS)
def test_a_shaken_pose_returns(vector, place):
    T, rng = pose(vector, place), np.random.default_rng(0)
    gray, edges = painted(T), Edges(CUBE)
    for _ in range(8):
        start = shaken(T, rng)
        met = edges.meet(start, gray, K)
        assert np.linalg.norm(start[:3, 3] - T[:3, 3]) > 0.01
        assert np.linalg.norm(met.T_camera_body[:3, 3] - T[:3, 3]) < 1e-3
        assert degrees_between(met.T_camera_body, T) < 0.5
        assert met.share > 0.9
        assert met.error < 0.3


@pytest.mark.parametrize("side", ["left", "right", "above", "below"])
def test_what_is_covered_does_not_pull(side):
    T, rng = pose(*VIEWS[0]), np.random.default_rng(1)
    gray = painted(T)
    u, v = (int(part) for part in project(T, np.zeros((1, 3)), K)[0])
    cover = {
        "left": np.s_[:, : u - 10], "right": np.s_[:, u + 10 :], "above": np.s_[: v - 10], "below": np.s_[v + 10 :]
    }  # fmt: skip
    gray[cover[side]] = 60
    met = Edges(CUBE).meet(shaken(T, rng), gray, K, T[:3, 2])
    assert np.linalg.norm(met.T_camera_body[:3, 3] - T[:3, 3]) < 2e-3
    assert 0.45 < met.share < 0.9  # it says that a part is missing
    assert met.error < 0.35


def test_a_pose_of_somewhere_else_is_not_met():
    T, edges, limits = pose(*VIEWS[0]), Edges(CUBE), Limits()
    gray = painted(T)
    for shift, angle in (([0.02, 0.0, 0.0], 0.0), ([0.0, -0.03, 0.0], 0.0), ([0, 0, 0], 0.6)):
        elsewhere = T.copy()
        elsewhere[:3, 3] += shift
        elsewhere[:3, :3] = T[:3, :3] @ turn([0, 0, angle])
        met = edges.meet(elsewhere, gray, K)
        assert met.share < limits.share or met.error > limits.error
    outside = T.copy()
    outside[0, 3] += 5.0
    for where, picture in ((T, np.full((480, 640), 130, np.uint8)), (T, painted(outside)), (outside, gray)):
        blank = edges.meet(where, picture, K)
        assert blank.share < 0.1


def test_what_is_up_holds_the_tilt():
    T, one = pose([0.3, 0.0, 0.2], [0.02, 0.0, 0.6]), Layout.of("tag36h11", [CUBE.tags[0]])
    tilts = []
    for up in (None, T[:3, 2]):
        met = [Edges(one).meet(T, painted(T, noise=8.0, seed=seed), K, up).T_camera_body for seed in range(4)]
        tilts.append(np.mean([np.degrees(np.arccos(min(1.0, M[:3, 2] @ T[:3, 2]))) for M in met]))
    free, upright = tilts
    assert upright < 0.5 * free
    assert upright < 0.3  # degrees
