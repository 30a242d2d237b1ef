"""Pose of a body from the edges between black and white on all its tags that are not covered.

A detection consists of the four corners of a tag that is wholly visible. A body that is partly hidden may show only one
such tag, slanted and small, whose corners determine its distance badly; but each edge that is not covered, on any tag,
can be located to a fraction of a pixel. Edges are searched where a first pose predicts them, and the pose is moved
until it agrees with the edges that are found; covered edges are not found and do not count (after Drummond and Cipolla,
"Real-time visual tracking of complex structures", PAMI 2002).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.layout import Layout, Tag
from collectors.apriltags.picture import modules, shape
from collectors.apriltags.pose import jacobian, project, turned_by

REACHES = (6.0, 4.0, 2.0, 2.0, 2.0)  # [px] search distance to both sides of an edge's predicted place, by round
NEIGHBOUR = 1.5  # [modules] largest search distance; the next edge with white and black in the same order is 2 away
SAMPLE = 0.5  # [px] between samples across an edge; the slope of the edge is taken over two of these distances
DOUBTED = 3.0  # an edge whose error is the search distance divided by this number has half its weight (Cauchy)
CONTRAST = 0.25  # least contrast of an edge, relative to the 75th percentile of all edges
LEAST = 15.0  # least contrast of an edge in grey levels over two samples; surely detected tags have 30 and more
FACING = 0.15  # cosine between a tag's normal and the line of sight, above which the tag's edges are searched
SMALLEST = 1.0  # [px] least size of a module across an edge
MET = 1.0  # [px] distance from its predicted place below which an edge counts as met
FEWEST = 12  # least number of edges for a pose


@dataclass(frozen=True)
class Meeting:
    """Agreement of a pose with the edges of a picture.

    Attributes:
        T_camera_body: Pose of the body in the camera's axes, (4, 4), [m].
        share: Share of the edges facing the camera that are found within `MET` of their predicted place, 0 to 1.
        error: Root mean square distance of these edges from their predicted places, measured across the edge, [px].
    """

    T_camera_body: NDArray[np.float64]
    share: float
    error: float


@dataclass(frozen=True)
class _Crossing:
    """Search results for the edges that face the camera in a picture, one row for each edge point of the body."""

    moves: NDArray[np.float64]  # (M, 6) motion of the edge, across it, per turn and shift of the body, [px/rad], [px/m]
    off: NDArray[np.float64]  # (M,) distance from the predicted to the found place of the edge, [px]
    found: NDArray[np.bool_]  # (M,) whether the edge was found


class Edges:
    """Edges between black and white on all tags of a body, in the body's axes."""

    def __init__(self, layout: Layout) -> None:
        """Derive the edges from the patterns of the tags.

        Args:
            layout: Tags of the body.
        """
        parts = [_edges(tag, layout.family) for tag in layout.tags.values()]
        self._points, self._inward, self._normals = (np.concatenate(some) for some in zip(*parts, strict=True))

    def meet(
        self,
        start: NDArray[np.float64],
        gray: NDArray[np.uint8],
        intrinsics: NDArray[np.float64],
        up: NDArray[np.float64] | None = None,
    ) -> Meeting:
        """Move a pose until the edges that it predicts agree with those of a picture.

        Args:
            start: T_camera_body that the fit starts from, which must predict edges within about a module of where they
                are, (4, 4), [m].
            gray: Grey picture, (H, W) uint8.
            intrinsics: Pinhole matrix of the camera, (3, 3), [px].
            up: Direction of the body's z axis in camera axes, (3,), or None if the body may be tilted.

        Returns:
            The pose that was found and its agreement with the picture. If fewer than `FEWEST` edges are found, it is
            the start pose with a share of 0 and an infinite error.
        """
        T = start
        for reach in REACHES:
            crossed = self._cross(T, gray, intrinsics, reach)
            if crossed.found.sum() < FEWEST:
                return Meeting(start, 0.0, np.inf)
            moves, off = crossed.moves[crossed.found], crossed.off[crossed.found]
            pull = 1.0 / np.sqrt(1.0 + (DOUBTED * off / reach) ** 2)
            T = turned_by(T, pull[:, None] * moves, pull * off, up)
        crossed = self._cross(T, gray, intrinsics, REACHES[-1])
        met = crossed.found & (np.abs(crossed.off) < MET)
        if met.sum() < FEWEST:
            return Meeting(start, 0.0, np.inf)
        return Meeting(T, float(met.mean()), float(np.sqrt(np.mean(crossed.off[met] ** 2))))

    def _cross(
        self, T: NDArray[np.float64], gray: NDArray[np.uint8], intrinsics: NDArray[np.float64], reach: float
    ) -> _Crossing:
        """Search across each edge for the steepest step from white to black."""
        R, seen = T[:3, :3], self._points @ T[:3, :3].T + T[:3, 3]
        faces = -((self._normals @ R.T) * seen).sum(axis=1) > FACING * np.linalg.norm(seen, axis=1)
        points, inward = self._points[faces], self._inward[faces] @ R.T
        along = np.cross(self._normals[faces] @ R.T, inward)
        moves = jacobian(T, points, intrinsics)
        direction, black = (np.einsum("mij,mj->mi", moves[:, :, 3:], vectors) for vectors in (along, inward))
        across = direction[:, ::-1] * (1.0, -1.0) / np.linalg.norm(direction, axis=1, keepdims=True)
        module = (across * black).sum(axis=1)
        across, module = across * np.sign(module)[:, None], np.abs(module)

        places = SAMPLE * np.arange(-round(reach / SAMPLE) - 1, round(reach / SAMPLE) + 2)
        where = project(T, points, intrinsics)[:, None] + places[:, None] * across[:, None]
        x, y = where.astype(np.float32).transpose(2, 0, 1)
        levels = cv2.remap(gray, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
        off, step = _steepest(levels[:, :-2] - levels[:, 2:], places[1:-1], NEIGHBOUR * module)
        strong = max(LEAST, CONTRAST * np.percentile(step, 75)) if len(step) else LEAST
        found = (step > strong) & np.isfinite(off) & (module > SMALLEST)
        return _Crossing(np.einsum("mi,mij->mj", across, moves), off, found)


def _steepest(
    steps: NDArray[np.floating], places: NDArray[np.floating], within: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the place of each row's peak (a parabola through three samples; NaN if there is none) and its height."""
    allowed = np.abs(places) <= np.minimum(within, places[-2])[:, None]
    best = np.where(allowed, steps, -np.inf).argmax(axis=1)
    rows, best = np.arange(len(steps)), np.clip(best, 1, len(places) - 2)
    before, top, after = (steps[rows, best + shift].astype(np.float64) for shift in (-1, 0, 1))
    peak = (before <= top) & (after <= top) & (before + after < 2 * top)
    bend = np.where(peak, 2 * top - before - after, 1.0)
    off = places[best] + SAMPLE * 0.5 * (after - before) / bend
    return np.where(peak, off, np.nan), top


def _edges(tag: Tag, family: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return edge midpoints, the vectors of one module towards black, and the tag's normals, (M, 3) each, [m]."""
    black, measures = modules(family, tag.id), shape(family)
    middle, found = measures.total / 2, []
    for turn in range(2):  # edges between left and right, then those between above and below
        step = np.diff(black.astype(np.int8), axis=1 - turn)
        row, column = np.nonzero(step)
        across = step[row, column].astype(np.float64)
        if turn:
            found.append(np.stack([column + 0.5 - middle, middle - row - 1.0, 0 * across, -across], axis=1))
        else:
            found.append(np.stack([column + 1.0 - middle, middle - row - 0.5, across, 0 * across], axis=1))
    x, y, inward_x, inward_y = tag.size / measures.border * np.concatenate(found).T
    flat, R = np.zeros_like(x), tag.T_body_tag[:3, :3]
    points = np.stack([x, y, flat], axis=1) @ R.T + tag.T_body_tag[:3, 3]
    return points, np.stack([inward_x, inward_y, flat], axis=1) @ R.T, np.broadcast_to(R[:, 2], points.shape)
