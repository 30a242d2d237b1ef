"""Action of planar rotations and reflections on the numbers of an episode.

Let R be the 2 x 2 orthogonal matrix of the group element and s = det R = +-1. Every field of an episode declares in
`svfl_data.schema.fields` of which parts it is made, and each part is one of the kinds below. The same action serves
three purposes: it converts vectors from base axes to image-aligned axes, augments data, and states the law that
networks are tested against.

A torque is an axial vector (Goldstein, Classical Mechanics, section 4.9). Under a reflection of the plane, its in-plane
part is multiplied by the sign s in addition to R. Its component along the normal of the plane, like every rotation
angle, is multiplied by s alone. For rotations (s = +1), axial and polar vectors transform in the same way.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal["invariant", "vector", "axial", "pseudoscalar", "angle"]
"""Kind of a part, by its transformation: ``invariant`` is unchanged, ``vector`` becomes R v, ``axial`` becomes s R v,
``pseudoscalar`` becomes s x, and ``angle`` (an angle in the plane) becomes s theta plus the rotation's angle."""


@dataclass(frozen=True)
class Part:
    """Components of a field's last axis that transform together.

    Attributes:
        kind: How the components transform.
        index: Positions of the components on the last axis: two for ``vector`` and ``axial``, any number for the
            others.

    Example:
        >>> Part("vector", (0, 1)).kind
        'vector'
    """

    kind: Kind
    index: tuple[int, ...]


PROPRIO_PARTS = (Part("invariant", (0,)), Part("vector", (1, 2)), Part("invariant", (3,)), Part("angle", (4,)))
ACTION_PARTS = (Part("invariant", (0,)), Part("vector", (1, 2)), Part("invariant", (3,)), Part("pseudoscalar", (4,)))
WRENCH_PARTS = (Part("vector", (0, 1)), Part("invariant", (2,)), Part("axial", (3, 4)), Part("pseudoscalar", (5,)))
OFFSET_PARTS = (Part("vector", (0, 1)),)

DIRECTIONS = ("right", "up", "left", "down")
"""Names of the four direction classes in image-aligned axes; class k points along (cos, sin)(k 90 degrees)."""


def element(degrees: float, flip: bool = False) -> np.ndarray:
    """Return the matrix of a planar group element: first the flip y -> -y (if any), then a counter-clockwise rotation.

    Args:
        degrees: Angle of the rotation, [deg].
        flip: Whether to mirror at the x axis before the rotation.

    Returns:
        Orthogonal matrix, shape (2, 2).
    """
    angle = math.radians(degrees)
    cos, sin = math.cos(angle), math.sin(angle)  # those of NumPy differ in the last digit between processors
    exact = np.round([[cos, -sin], [sin, cos]], 15)  # quarter turns come out as exact 0 and 1
    return exact @ np.diag([1.0, -1.0 if flip else 1.0])


def cyclic(order: int) -> list[np.ndarray]:
    """Return the rotations of C_order, counter-clockwise, as matrices of shape (2, 2)."""
    return [element(360.0 * k / order) for k in range(order)]


def dihedral(order: int) -> list[np.ndarray]:
    """Return all 2 * order elements of D_order, rotations first, as matrices of shape (2, 2)."""
    return [element(360.0 * k / order, flip) for flip in (False, True) for k in range(order)]


def act(matrix: np.ndarray, values: np.ndarray, parts: Sequence[Part]) -> np.ndarray:
    """Apply a planar rotation or reflection to an array of readings.

    Args:
        matrix: Orthogonal matrix R, shape (2, 2).
        values: Numbers whose last axis is described by `parts`, shape (..., C). A position must be given relative to
            the fixed point of the rotation, which is the centre of the workspace.
        parts: Parts of the C components. Components that belong to no part stay unchanged.

    Returns:
        The transformed array, same shape and dtype.

    Example:
        >>> quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        >>> act(quarter, np.array([1.0, 0.0]), [Part("vector", (0, 1))]).round(6).tolist()
        [0.0, 1.0]
    """
    sign = np.linalg.det(matrix)
    turn = np.arctan2(matrix[1, 0], matrix[0, 0])  # the image of the x axis
    out = np.array(values, copy=True)
    for part in parts:
        index = list(part.index)
        chosen = np.asarray(values)[..., index]
        if part.kind == "vector":
            out[..., index] = chosen @ matrix.T
        elif part.kind == "axial":
            out[..., index] = sign * (chosen @ matrix.T)
        elif part.kind == "pseudoscalar":
            out[..., index] = sign * chosen
        elif part.kind == "angle":
            out[..., index] = sign * chosen + turn
    return out


def act_on_image(matrix: np.ndarray, image: np.ndarray, axes: tuple[int, int] = (-2, -1)) -> np.ndarray:
    """Turn a square image by quarter turns and/or flip it, exactly (without interpolation).

    Args:
        matrix: One of the eight elements of D4, shape (2, 2), in image-aligned axes (x right, y up).
        image: Array of which two axes are those of an image of shape (H, H).
        axes: Row axis and column axis of the image; rows run downwards.

    Returns:
        The moved image, same shape.

    Raises:
        ValueError: If the matrix is not an element of D4 (other angles do not map pixels onto pixels).
    """
    exact = np.round(matrix)
    if not np.allclose(matrix, exact, atol=1e-6):
        raise ValueError(f"only multiples of 90 degrees and flips move pixels onto pixels, got R = {matrix.tolist()}")
    moved = np.flip(image, axis=axes[0]) if np.linalg.det(exact) < 0 else image  # y -> -y turns rows around
    rotation = exact @ np.diag([1.0, np.linalg.det(exact)])
    quarter_turns = int(np.round(np.arctan2(rotation[1, 0], rotation[0, 0]) / (np.pi / 2))) % 4
    return np.rot90(moved, quarter_turns, axes=axes)  # rot90 turns counter-clockwise for (row, column)


def act_on_direction(matrix: np.ndarray, direction: np.ndarray | int) -> np.ndarray:
    """Return direction classes after a rotation or reflection of D4.

    Args:
        matrix: Element of D4, shape (2, 2), in image-aligned axes.
        direction: Direction classes 0 to 3 (`DIRECTIONS`), any shape.

    Returns:
        The moved classes, int64, same shape.
    """
    angle = np.asarray(direction) * (np.pi / 2)
    return nearest_direction(np.stack([np.cos(angle), np.sin(angle)], axis=-1) @ matrix.T)


def nearest_direction(vector: np.ndarray) -> np.ndarray:
    """Return the direction class (`DIRECTIONS`) that is nearest to each vector.

    Args:
        vector: Vectors in image-aligned axes, shape (..., 2).

    Returns:
        Direction classes 0 to 3, int64, shape (...).
    """
    quarter = np.arctan2(vector[..., 1], vector[..., 0]) / (np.pi / 2)
    return np.asarray(np.round(quarter).astype(np.int64) % 4)


def points_towards(direction: int, vector: np.ndarray) -> bool:
    """Return whether no other direction class is nearer to a vector; on the border of two classes, both are right.

    Args:
        direction: Direction class 0 to 3 (`DIRECTIONS`).
        vector: Vector in image-aligned axes, shape (2,).
    """
    angle = direction * np.pi / 2
    return bool(vector @ [np.cos(angle), np.sin(angle)] >= np.abs(vector).max() - 1e-9)


def border_distance(vector: np.ndarray) -> np.ndarray:
    """Return the angle between each vector and the nearest border of two direction classes.

    Args:
        vector: Vectors in image-aligned axes, shape (..., 2).

    Returns:
        Angles, shape (...), [rad].
    """
    quarter = np.arctan2(vector[..., 1], vector[..., 0]) / (np.pi / 2)
    return np.asarray((0.5 - np.abs(quarter - np.round(quarter))) * (np.pi / 2))


def parts_named(parts: Iterable[Part], names: Sequence[str]) -> str:
    """Return a description of parts for the documentation of the format, e.g. ``vector(fx, fy), invariant(fz)``.

    Args:
        parts: Parts to describe.
        names: Names of the components along the last axis.
    """
    return ", ".join(f"{part.kind}({', '.join(names[i] for i in part.index)})" for part in parts)
