"""The view from straight above, computed from the colour and depth images of cameras in any pose.

Rotating or reflecting the workspace about its centre rotates or reflects this view pixel for pixel, as far as the
cameras have seen the scene. An oblique image does not have this property: there the symmetry of the task is only latent
(Wang et al., "The surprising effectiveness of equivariant models in domains with latent symmetry", ICLR 2023).

Every pixel of a depth image is a small patch of a surface. The patches are projected onto the plane, and the highest
patch is drawn (surface splatting: Zwicker et al., SIGGRAPH 2001). A pixel that no patch covers was hidden from the
cameras or outside their images, and is 0. No value is invented for it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.errors import UsageError
from svfl_data.schema.robot import Frame, Optics

SIZE = 76  # [px], as the images of the paper
EYE_M = 1.0  # [m], higher than the arm moves over a table; depth is then 1 m minus the height
FARTHEST = 2**16 - 1  # largest uint16
MOST_POINTS = 2 * 10**7
"""Largest number of points of one camera image, which take 400 MB while they are drawn. A camera of 640 x 480 px above
a table gives 3 * 10^5 points."""


@dataclass(frozen=True, eq=False)
class TopView:
    """Camera without perspective that looks straight down at the middle of the workspace.

    Attributes:
        centre: Position of the middle of the view, base (x, y), shape (2,), [m].
        image_axes: Orthogonal matrix from base (x, y) to the (right, up) of the view, shape (2, 2). It is that of the
            camera from which the view is made, so that a vector in image-aligned axes fits both images.
        size: Height and width of the view, [px].
        extent: Edge of the square that the view shows, [m].
        depth_scale: Metres per unit of depth, [m].
        eye: Height from which depth is measured, base z, [m]. Surfaces above this height are not drawn. A low eye
            therefore shows what the cameras saw beneath the gripper.
    """

    centre: np.ndarray
    image_axes: np.ndarray
    size: int
    extent: float
    depth_scale: float
    eye: float = EYE_M

    def __post_init__(self) -> None:
        """Check that size and extent are possible.

        Raises:
            UsageError: If size or extent are not positive.
        """
        if self.size < 1:
            raise UsageError(f"size is {self.size} px; a picture has at least 1")
        if not 0 < self.extent < math.inf:
            raise UsageError(f"extent is {self.extent:g} m; it must be positive")

    @classmethod
    def over(
        cls,
        workspace: np.ndarray,
        optics: Optics,
        size: int = SIZE,
        extent: float | None = None,
        eye: float = EYE_M,
    ) -> "TopView":
        """Return the view of a workspace that has the axes and the depth scale of a camera.

        Args:
            workspace: Bounds of x, y, z in base, shape (3, 2), [m].
            optics: Geometry of the camera that gives axes and depth scale.
            size: Height and width of the view, [px].
            extent: Edge of the square that the view shows, [m]. The wider side of the workspace by default.
            eye: Height from which depth is measured, base z, [m]. Surfaces above this height are not drawn.

        Raises:
            UsageError: If size or extent are not positive.
        """
        sides = np.asarray(workspace, np.float64)[:2]
        edge = float(np.ptp(sides, axis=1).max()) if extent is None else extent
        return cls(sides.mean(axis=1), np.asarray(optics.image_axes), size, edge, float(optics.depth_scale), eye)

    @property
    def metres_per_pixel(self) -> float:
        """Edge of a pixel on the table, [m], which is the same everywhere in the view."""
        return self.extent / self.size

    def pixel(self, xy: np.ndarray) -> np.ndarray:
        """Return the position of points in the view.

        Args:
            xy: Points in base (x, y), shape (..., 2), [m].

        Returns:
            Rows and columns, shape (..., 2), [px]. The centre of the first pixel is at (0, 0).
        """
        right_up = (np.asarray(xy) - self.centre) @ self.image_axes.T / self.metres_per_pixel
        return right_up[..., ::-1] * [-1.0, 1.0] + (self.size - 1) / 2

    def height_m(self, depth: np.ndarray) -> np.ndarray:
        """Return the base z of the surface that a depth image of this view shows.

        Args:
            depth: Depth image of the view, in units of `depth_scale`, any shape.

        Returns:
            Base z, same shape, [m]; NaN where the depth is 0, because nothing was seen.
        """
        return np.where(depth > 0, self.eye - depth * self.depth_scale, np.nan)

    def draw(self, pictures: Sequence[tuple[Frame, Optics]]) -> tuple[np.ndarray, np.ndarray]:
        """Draw the view from the images that one or several cameras took at one moment.

        Args:
            pictures: Frame and geometry of each camera.

        Returns:
            Colour image (size, size, 3) uint8, black where nothing was seen, and depth image (size, size) uint16 in
            units of `depth_scale`, 0 where nothing was seen.

        Raises:
            UsageError: If the view needs more than `MOST_POINTS` points of one camera.
        """
        patches = [self._patches(picture, optics) for picture, optics in pictures]
        places, colors = (np.concatenate(part, axis=1) for part in zip(*patches, strict=True))
        return self.splat(places, colors)

    def splat(self, places: np.ndarray, colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Draw points into a colour image and a depth image.

        Each pixel is the mean of the points in it that lie at most one pixel width below the highest of them. All sums
        are sums of integers, so that neither the order of the points nor a rotation of the scene changes a single bit
        of them.

        Args:
            places: Positions of the points, shape (3, P), [m]: right and up from the middle of the view, and down from
                the eye.
            colors: Colours of the points, shape (3, P), uint8.

        Returns:
            Colour image and depth image, as from `draw`.
        """
        size, outside = self.size, self.size**2
        right, up, down = places
        column = np.floor(right / self.metres_per_pixel + size / 2)
        row = np.floor(size / 2 - up / self.metres_per_pixel)
        units = np.rint(down / self.depth_scale)
        inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < size) & (units > 0) & (units <= FARTHEST)
        pixel = np.where(inside, row * size + column, outside).astype(np.intp)
        nearest = np.full(outside + 1, FARTHEST, units.dtype)
        np.minimum.at(nearest, pixel, units)
        nearest[outside] = -np.inf
        top = np.flatnonzero(units <= nearest[pixel] + round(self.metres_per_pixel / self.depth_scale))
        pixel = pixel[top]
        sums = [np.bincount(pixel, values[top], outside) for values in (units, *colors)]
        means = np.rint(sums / np.maximum(np.bincount(pixel, minlength=outside), 1)).reshape(4, size, size)
        return np.ascontiguousarray(means[1:].transpose(1, 2, 0), np.uint8), means[0].astype(np.uint16)

    def _patches(self, picture: Frame, optics: Optics) -> tuple[np.ndarray, np.ndarray]:
        """Return the surface that one camera saw, as points for `splat` that are at most a pixel of this view apart."""
        depth, color = np.asarray(picture.depth), np.asarray(picture.color)
        points = self._points(depth, optics)
        count = self._fineness(optics)
        reach = count * self.metres_per_pixel
        seen = depth > 0
        chosen = np.flatnonzero(seen & (np.abs(points[:2]) <= 0.5 * self.extent + reach).all(axis=0))
        if len(chosen) * count**2 > MOST_POINTS:
            raise UsageError(
                f"a view from above of {self.size} px needs {len(chosen) * count**2:.1g} points of a camera as coarse "
                f"as this, possible are {MOST_POINTS:.1g}; choose a smaller size or a larger extent"
            )
        colors = color.reshape(-1, 3)[chosen].T
        places = points.reshape(3, -1)[:, chosen]
        if count > 1 and len(chosen):
            offsets = ((np.arange(count) - 0.5 * (count - 1)) / count).astype(np.float32)
            down, across = (self._towards(points, seen, axis, chosen, offsets, reach) for axis in (0, 1))
            places = (places[:, None, None] + down[:, :, None] + across[:, None]).reshape(3, -1)
            colors = np.tile(colors, count**2)
        return places, colors

    def _points(self, depth: np.ndarray, optics: Optics) -> np.ndarray:
        """Return each pixel's point, (3, H, W), [m]: right and up from the middle of this view, down from its eye."""
        axes = np.zeros((3, 3))
        axes[:2, :2], axes[2, 2] = self.image_axes, -1.0
        K, T = np.asarray(optics.intrinsics), np.asarray(optics.T_base_camera)
        to_view = (axes @ T[:3, :3] @ np.linalg.inv(K))[..., None, None]
        rows, columns = np.arange(depth.shape[0])[:, None], np.arange(depth.shape[1])
        rays = columns * to_view[:, 0] + rows * to_view[:, 1] + to_view[:, 2]
        start = axes @ (T[:3, 3] - [*self.centre, self.eye])
        return (start[:, None, None] + rays * (depth * float(optics.depth_scale))).astype(np.float32)

    def _fineness(self, optics: Optics) -> int:
        """Return the number of points into which a camera's pixel is divided along each side.

        The spacing of the points on the table is then at most a pixel of this view. A pixel at distance r that is seen
        from height h covers at most r / f by r / f * r / h, where f is the focal length in pixels.
        """
        x, y, h = np.asarray(optics.T_base_camera)[:3, 3]
        corners = self.extent / 2 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) @ self.image_axes + self.centre
        r = np.sqrt(((corners - [x, y]) ** 2).sum(axis=1).max() + h**2)
        focal = min(optics.intrinsics[0, 0], optics.intrinsics[1, 1])
        return max(1, math.ceil(r / focal * r / max(h, 0.2 * r) / self.metres_per_pixel))

    @staticmethod
    def _towards(
        points: np.ndarray, seen: np.ndarray, axis: int, chosen: np.ndarray, offsets: np.ndarray, reach: float
    ) -> np.ndarray:
        """Return how far the surface at chosen pixels extends along one axis of the image, (3, offsets, P), [m].

        A neighbour belongs to the same surface if it is no farther away in space than `reach`. Towards such a
        neighbour, the surface extends straight to it. Beyond an edge of the surface, it extends as on the other side of
        the pixel. A pixel without such neighbours is a single point.
        """
        low, high = (np.s_[..., :-1, :], np.s_[..., 1:, :]) if axis == 0 else (np.s_[..., :-1], np.s_[..., 1:])
        steps = points[high] - points[low]
        joined = seen[high] & seen[low] & ((steps**2).sum(axis=0) <= reach**2)
        steps *= joined
        ahead, behind = np.zeros_like(points), np.zeros_like(points)
        ahead[low], behind[high] = steps, steps
        ahead, behind = ahead.reshape(3, -1)[:, chosen], behind.reshape(3, -1)[:, chosen]
        ahead, behind = np.where(ahead.any(axis=0), ahead, behind), np.where(behind.any(axis=0), behind, ahead)
        return np.stack([offset * (ahead if offset > 0 else behind) for offset in offsets], axis=1)
