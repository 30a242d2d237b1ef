"""Pictures of boxes on a table, whose true geometry is known: a pinhole camera is simulated by exact ray casting.

Lengths are in metres and positions in base. The axes are those of `svfl_data.schema.robot.Calibration`: camera x points
to the right, y down and z forward, and the centre of the top left pixel is at (0, 0). A pixel shows what the ray
through its centre hits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from svfl_data.schema.robot import Calibration, Frame

GREY = (110, 110, 110)
FACES = ((200, 40, 40), (40, 200, 40), (40, 40, 200), (200, 200, 40), (240, 240, 240), (10, 10, 10))
"""Colours of the faces of a box. Their order is +x, -x, +y, -y, +z, -z of the box's own axes."""
CLOSE = 1e-9
"""Bound on the rounding of a ray, relative to its length. Some 10 operations, each of 2e-16, act on lengths of about a
metre; the rest is a margin for rays that meet a face at a small angle."""


@dataclass(frozen=True)
class Box:
    """Box that is turned about base z.

    Attributes:
        half: Half the edges along the box's own axes, [m].
        centre: Centre in base, [m].
        yaw: Angle from base x to the box's own x, about base z, [rad].
        colors: One colour (red, green, blue), or one for each face in the order of `FACES`.
    """

    half: Sequence[float]
    centre: Sequence[float]
    yaw: float = 0.0
    colors: Sequence = FACES

    def cast(self, start: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where rays enter the box and through which of `FACES`, both of shape (...).

        The place is a multiple of the ray, and `inf` for a ray that misses the box. The box is the intersection of
        three slabs (Kay and Kajiya, "Ray tracing complex scenes", 1986): a ray is inside from where it enters the last
        slab until it leaves the first.
        """
        own = planar(rotation(self.yaw))  # its columns are the box's own axes
        start, rays = (np.asarray(start) - self.centre) @ own, rays @ own
        enters, leaves = np.full(rays.shape[:-1], -np.inf), np.full(rays.shape[:-1], np.inf)
        faces = np.zeros(rays.shape[:-1], np.intp)
        for axis, half in enumerate(self.half):
            ray = nonzero(rays[..., axis])
            low, high = (-half - start[..., axis]) / ray, (half - start[..., axis]) / ray
            enters_slab = np.minimum(low, high)
            faces = np.where(enters_slab > enters, 2 * axis + (ray > 0), faces)  # a ray along the axis enters by -x
            enters, leaves = np.maximum(enters, enters_slab), np.minimum(leaves, np.maximum(low, high))
        return np.where((enters <= leaves) & (enters > 0.0), enters, np.inf), faces

    @property
    def face_colors(self) -> np.ndarray:
        """Return the colour of each face in the order of `FACES`, shape (6, 3)."""
        return np.broadcast_to(np.asarray(self.colors, np.uint8), (6, 3))

    def moved(self, matrix: np.ndarray, centre: np.ndarray) -> "Box":
        """Return the box after a rotation or reflection of base (x, y) about a centre."""
        xy = centre + matrix @ (np.asarray(self.centre[:2]) - centre)
        angle = np.arctan2(matrix[1, 0], matrix[0, 0])
        mirrored = np.linalg.det(matrix) < 0
        yaw = angle - self.yaw if mirrored else angle + self.yaw
        order = [0, 1, 3, 2, 4, 5] if mirrored else range(6)  # a reflection reverses the box's own y
        return Box(self.half, (*xy, self.centre[2]), yaw, self.face_colors[[*order]])


@dataclass(frozen=True)
class Scene:
    """Scene of boxes and a table.

    Attributes:
        boxes: The boxes.
        table: Height of the table, base z, [m], or None if there is none. It has no borders.
        color: Colour of the table.
    """

    boxes: Sequence[Box] = ()
    table: float | None = 0.0
    color: Sequence[int] = GREY

    def cast(self, start: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where rays first hit something, shape (...), and the colour there, shape (..., 3).

        The place is a multiple of the ray, and `inf` for a ray that hits nothing.

        Args:
            start: Point in base from which the rays start, shape (..., 3), [m].
            rays: Directions in base, shape (..., 3).
        """
        rays = np.asarray(rays, np.float64)
        nearest = np.full(rays.shape[:-1], np.inf)
        colors = np.zeros((*rays.shape[:-1], 3), np.uint8)
        if self.table is not None:
            ahead = (self.table - np.asarray(start)[..., 2]) / nonzero(rays[..., 2])
            hit = ahead > 0.0
            nearest[hit], colors[hit] = ahead[hit], self.color
        for box in self.boxes:
            there, faces = box.cast(start, rays)
            hit = there < nearest
            nearest[hit], colors[hit] = there[hit], box.face_colors[faces[hit]]
        return nearest, colors

    def render(self, camera: Calibration, shape: tuple[int, int] = (76, 76)) -> Frame:
        """Return what a camera sees. The depth is 0 where a ray hits nothing or 16 bits do not hold the depth."""
        rows, columns = np.mgrid[: shape[0], : shape[1]]
        rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera.intrinsics).T
        # The rays reach 1 m along the optical axis, so that their multiples are depths.
        depth, colors = self.cast(camera.T_base_camera[:3, 3], rays @ camera.T_base_camera[:3, :3].T)
        units = np.rint(depth / camera.depth_scale)
        return Frame(colors, np.where(units <= np.iinfo(np.uint16).max, units, 0).astype(np.uint16))

    def from_above(self, xy: np.ndarray, above: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
        """Return base z of the highest surface below `above`, [m], and its colour, at places in base of shape (..., 2).

        The height is `-inf` where there is no surface.
        """
        start = np.concatenate([xy, np.full((*np.shape(xy)[:-1], 1), above)], axis=-1)
        down, colors = self.cast(start, np.broadcast_to([0.0, 0.0, -1.0], start.shape))
        return above - down, colors

    def shows(self, camera: Calibration, points: np.ndarray) -> np.ndarray:
        """Return whether a camera has a free line of sight to points on surfaces in base, shape (..., 3).

        All points have to be in front of the camera; the borders of its image are not taken into account.
        """
        eye = camera.T_base_camera[:3, 3]
        return self.cast(eye, np.asarray(points) - eye)[0] >= 1.0 - CLOSE

    def moved(self, matrix: np.ndarray, centre: np.ndarray) -> "Scene":
        """Return the scene after a rotation or reflection of base (x, y) about a centre."""
        return replace(self, boxes=[box.moved(matrix, centre) for box in self.boxes])


def look_at(
    eye: Sequence[float] = (1.1, 0.0, 0.6),
    target: Sequence[float] = (0.55, 0.0, 0.0),
    up: Sequence[float] = (-1.0, 0.0, 0.0),
    fov_deg: float = 40.0,
    shape: tuple[int, int] = (76, 76),
    depth_scale: float = 1e-4,
) -> Calibration:
    """Return the calibration of a camera with square pixels whose optical axis goes through the middle of its image.

    Args:
        eye: Optical centre in base, [m].
        target: Point in base on the optical axis, [m].
        up: Direction in base that is up in the image.
        fov_deg: Vertical field of view, between the outer edges of the first and the last row, [deg].
        shape: Height and width of the images, [px].
        depth_scale: Metres per unit of depth, [m].
    """
    height, width = shape
    focal = height / 2 / np.tan(np.radians(fov_deg) / 2)
    intrinsics = np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    z = np.subtract(target, eye)
    z = z / np.linalg.norm(z)
    x = np.cross(z, up)
    x = x / np.linalg.norm(x)
    T_base_camera = np.eye(4)
    T_base_camera[:3] = np.column_stack([x, np.cross(z, x), z, eye])
    right = x[:2] / np.linalg.norm(x[:2])
    above = 1.0 if z[2] < 0 else -1.0  # a camera that looks up sees a mirrored table
    return Calibration(
        intrinsics, T_base_camera, np.array([right, above * np.array([-right[1], right[0]])]), depth_scale
    )


def moved_camera(camera: Calibration, matrix: np.ndarray, centre: np.ndarray) -> Calibration:
    """Return a camera after a rotation or reflection of base (x, y) about a centre. Its image axes are left unchanged.

    After a reflection the camera's axes are left-handed: its image of the mirrored scene is equal to that of the
    original camera of the original scene.
    """
    move = planar(matrix, centre - matrix @ centre)
    return replace(camera, T_base_camera=move @ camera.T_base_camera)


def nonzero(ray: np.ndarray) -> np.ndarray:
    """Return a component of rays in which 0 is replaced by 1e-30, so that a division by it is possible.

    Such a ray meets the planes of this axis 10^20 m away or farther, or at once if it starts in one of them.
    """
    return np.where(ray == 0.0, 1e-30, ray)


def rotation(angle: float) -> np.ndarray:
    """Return the rotation of the plane by an angle, shape (2, 2)."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def planar(matrix: np.ndarray, shift: np.ndarray | None = None) -> np.ndarray:
    """Return a map of base (x, y) as one of directions, shape (3, 3), or with a shift [m] one of places, (4, 4)."""
    move = np.eye(3 if shift is None else 4)
    move[:2, :2] = matrix
    if shift is not None:
        move[:2, 3] = shift
    return move
