"""What an episode may hold: the one place that decides it, for writers, readers and ``svfl-data validate``.

Three classes of faults are told apart. An *invalid* episode, which this module finds, is read by nobody: its numbers
have no meaning (a camera pose that is no pose, a wrench of 3e38 N, a depth without its unit), and programs would end in
a division by zero. An *error* of `svfl_data.checks` is a sound recording of something that went wrong, such as a stuck
sensor: viewers and plots show it, training refuses it. A *warning* is said, and training goes on.

Arrays may lie in memory or on disk. Images are judged by their shapes: every pixel is a valid one.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.fields import (
    CAMERA,
    EXTRA,
    FIELDS,
    OF_CAMERA,
    OF_EPISODE,
    PLAIN_KINDS,
    Field,
    camera_names,
    field_at,
    harmless,
    shape_words,
)
from svfl_data.system.printable import printable

UNIT = 1e-3
"""How far the norm of a quaternion, or the product of a rotation with its transpose, may be off: rounding."""
SHORTEST_FOCAL_PX = 1.0
NARROWEST_M = 1e-3
"""A workspace that is narrower is none."""
BLOCK_ROWS = 2**16
INNER = ("H", "W", "J")
"""Symbols of sizes that are never zero: an image has pixels, an arm has joints."""

Sizes = dict[str, tuple[int, str]]
"""Each symbol's size so far, and the path that set it."""


class Readable(Protocol):
    """An array in memory or on disk."""

    @property
    def dtype(self) -> np.dtype:
        """Type of its numbers."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its sizes."""

    def __getitem__(self, rows: slice, /) -> np.ndarray: ...


@dataclass(frozen=True)
class Fault:
    """Why an episode is invalid.

    Attributes:
        path: Dataset path.
        words: What is wrong, with the path.
    """

    path: str
    words: str


def faults(arrays: Mapping[str, Readable], values: bool = True) -> Iterator[Fault]:
    """What makes an episode invalid, in the order of the declarations.

    Args:
        arrays: Dataset path to array, in memory or on disk; what is declared and not an image is read, in blocks.
        values: Whether to judge numbers as well, rather than types, shapes and sizes only.
    """
    for path, array in arrays.items():
        if not harmless(path):
            yield Fault(
                path, f"{printable(path, 80)!r} is not a name for an array; parts are printable, not empty, . or .."
            )
        if field_at(path) is None and not path.startswith(EXTRA):
            known = ", ".join(field.path for field in FIELDS)
            yield Fault(path, f"unknown field {path!r}; an episode has {known} and anything below {EXTRA}")
        if path.startswith(EXTRA) and array.dtype.kind not in PLAIN_KINDS:
            yield Fault(path, f"{path} has dtype {array.dtype}; possible are numbers, booleans and byte strings")
    sizes: Sizes = {}
    yield from _group_faults({field.path: field for field in OF_EPISODE.values()}, arrays, sizes, values)
    if {"N+1", "N"} <= sizes.keys() and sizes["N+1"][0] != sizes["N"][0] + 1:
        rows, actions = sizes["N+1"][0], sizes["N"][0]
        yield Fault(sizes["N"][1], f"{rows} observations need {rows - 1} actions, found {actions}")
    for camera in camera_names(arrays):
        of_camera = {field.path.replace(CAMERA, camera): field for field in OF_CAMERA.values()}
        yield from _group_faults(of_camera, arrays, {}, values)
        if f"cameras/{camera}/depth" in arrays and f"cameras/{camera}/depth_scale" not in arrays:
            scale = f"cameras/{camera}/depth_scale"
            yield Fault(scale, f"field {scale} is missing, so the depth has no unit")


def check_arrays(arrays: Mapping[str, Readable], where: str, values: bool = True) -> None:
    """Refuse the arrays of an invalid episode.

    Args:
        arrays: As for `faults`.
        where: What to name in the error, such as the file.
        values: As for `faults`.

    Raises:
        FieldError: If a field is missing or unknown, has a wrong dtype or shape, disagrees with another field about
            a size, or holds a number that is impossible.
    """
    for fault in faults(arrays, values):
        raise FieldError(f"{where}: {fault.words}")


def check_array(field: Field, array: np.ndarray, sizes: Sizes, here: str, path: str) -> None:
    """Refuse one array that does not fit its declaration.

    Args:
        field: The declaration.
        array: What is to be stored.
        sizes: Each symbol's size so far; symbols met for the first time are added.
        here: What to name in the error, such as the file and the path.
        path: Where the array is stored.

    Raises:
        FieldError: If dtype or shape are not as declared, a size disagrees, or a number is impossible.
    """
    for words in (*_shape_faults(field, array, sizes, path), *_value_faults(field, array)):
        raise FieldError(f"{here} {words}")


def _group_faults(
    fields: Mapping[str, Field], arrays: Mapping[str, Readable], sizes: Sizes, values: bool
) -> Iterator[Fault]:
    """Faults of fields that share their symbols."""
    for path, field in fields.items():
        clock = f"{path.rpartition('/')[0]}/t_ns"
        if path in arrays:
            wrong = list(_shape_faults(field, arrays[path], sizes, path))
            if values and not wrong:
                wrong = list(_value_faults(field, arrays[path]))
            yield from (Fault(path, f"field {path} {words}") for words in wrong)
            if clock in fields and clock not in arrays and field.shape[:1] == fields[clock].shape:
                yield Fault(clock, f"field {clock} is missing, so {path} has no times")
        elif not field.optional:
            yield Fault(path, f"field {path} is missing")


def _shape_faults(field: Field, array: Readable, sizes: Sizes, path: str) -> Iterator[str]:
    if array.dtype != np.dtype(field.dtype):
        yield f"has dtype {array.dtype}, expected {field.dtype}"
    elif len(array.shape) != len(field.shape):
        yield f"has shape {array.shape}, expected {shape_words(field)}"
    else:
        for found, expected in zip(array.shape, field.shape, strict=True):
            if isinstance(expected, int) and found != expected:
                yield f"has shape {array.shape}, expected {shape_words(field)}"
            elif expected in INNER and found == 0:
                yield f"has shape {array.shape}: {expected} in {shape_words(field)} must be at least 1"
            elif isinstance(expected, str):
                known, owner = sizes.setdefault(expected, (found, path))
                if found != known:
                    yield f"has {expected} = {found}, but {owner} has {expected} = {known}"


def _value_faults(field: Field, array: Readable) -> Iterator[str]:
    """What is wrong with the numbers of an array whose shape is right; at most one thing."""
    if field.image:
        return
    rule = RULES.get(field.path)
    for first, block in _blocks(array):
        wrong = _out_of_bounds(field, block, first) or (rule and rule(block, first))
        if wrong:
            yield wrong
            return


def _blocks(array: Readable) -> Iterator[tuple[int, np.ndarray]]:
    """The array in pieces of some rows, each with the number of its first row."""
    if not array.shape:
        yield 0, np.asarray(array)
    for first in range(0, array.shape[0] if array.shape else 0, BLOCK_ROWS):
        yield first, np.asarray(array[first : first + BLOCK_ROWS])


def _out_of_bounds(field: Field, values: np.ndarray, first: int) -> str | None:
    low, high = field.bounds
    inside = (values >= low) & (values <= high)  # false for NaN
    if inside.all():
        return None
    place = tuple(int(i) for i in np.argwhere(~inside)[0])
    number = values[place]
    index = f" at index {(place[0] + first, *place[1:])}" if place else ""
    if not math.isfinite(number):
        return f"holds {number}{index}; only finite numbers are stored"
    return f"holds {number:.6g}{index}; possible are {low:.6g} to {high:.6g}"


def _no_pose(matrix: np.ndarray, first: int) -> str | None:
    rotation = matrix[:3, :3]
    rigid = _orthogonal(rotation) and np.linalg.det(rotation) > 0
    if rigid and np.allclose(matrix[3], [0, 0, 0, 1], atol=UNIT):
        return None
    return "is not a pose: its rotation or its last row is off"


def _not_orthogonal(matrix: np.ndarray, first: int) -> str | None:
    return None if _orthogonal(matrix) else "is not an orthogonal matrix"


def _orthogonal(matrix: np.ndarray) -> bool:
    return bool(np.allclose(matrix @ matrix.T, np.eye(len(matrix)), atol=UNIT))


def _no_pinhole(matrix: np.ndarray, first: int) -> str | None:
    focal = np.diag(matrix)[:2]
    if (focal < SHORTEST_FOCAL_PX).any():
        return f"has focal lengths {focal.tolist()} px; possible are {SHORTEST_FOCAL_PX:g} px and more"
    below = (matrix[1, 0], *matrix[2])
    return None if np.allclose(below, (0, 0, 0, 1), atol=UNIT) else "is not a pinhole matrix [fx s cx; 0 fy cy; 0 0 1]"


def _not_unit(poses: np.ndarray, first: int) -> str | None:
    norm = np.linalg.norm(poses[:, 3:], axis=1)
    if not len(rows := np.flatnonzero(np.abs(norm - 1) > UNIT)):
        return None
    return f"has a quat_xyzw of norm {norm[rows[0]]:.4g} at index ({rows[0] + first},); a rotation has norm 1"


def _no_room(bounds: np.ndarray, first: int) -> str | None:
    if not len(axes := np.flatnonzero(bounds[:, 1] - bounds[:, 0] < NARROWEST_M)):
        return None
    low, high = bounds[axes[0]]
    return f"is from {low:g} to {high:g} m at index ({axes[0]},): the lower bound must be below the upper bound"


RULES: dict[str, Callable[[np.ndarray, int], str | None]] = {
    "streams/object/pose": _not_unit,
    "streams/tags/pose": _not_unit,
    "cameras/{camera}/intrinsics": _no_pinhole,
    "cameras/{camera}/T_base_camera": _no_pose,
    "cameras/{camera}/image_axes": _not_orthogonal,
    "workspace": _no_room,
}
"""What more is asked of some fields: a block of rows and the number of its first -> what is wrong with it."""
