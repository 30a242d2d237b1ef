"""The only place that decides whether an episode is valid, for writers, readers and ``svfl-data validate``.

Three classes of faults are distinguished. An *invalid* episode, which this module finds, is refused by every reader,
because its numbers have no meaning (a camera pose that is no pose, a wrench of 3e38 N, a depth without its unit) and
programs would end in a division by zero. An *error* of `svfl_data.checks` is a sound recording of something that went
wrong, such as a stuck sensor; viewers and plots show it, training refuses it. A *warning* is printed, and training goes
on.

Arrays may lie in memory or on disk. Images are checked by their shapes only, because every pixel value is valid.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.field import Field
from svfl_data.schema.fields import EXTRA, FIELDS, PLAIN_KINDS, camera_names, harmless
from svfl_data.schema.value_rules import rule_of
from svfl_data.system.printable import printable

BLOCK_ROWS, BLOCK_NUMBERS = 2**16, 2**21
"""Largest number of rows, and of numbers, that are looked at at once."""
OBSERVED = "observations/t_ns"
POSES = ("T_base_camera", "T_base_camera_per_frame", "T_tcp_camera")
"""Arrays of a camera that give its pose, of which it has one at most."""

Sizes = dict[str, tuple[int, str]]
"""Size of each symbol that was found so far, and the path of the array that set it."""


class Readable(Protocol):
    """Protocol of an array in memory or on disk."""

    @property
    def dtype(self) -> np.dtype:
        """Type of the numbers in the array."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the array."""

    def __getitem__(self, rows: slice, /) -> np.ndarray: ...


@dataclass(frozen=True)
class Fault:
    """Reason why an episode is invalid.

    Attributes:
        path: Dataset path of the array that is wrong.
        words: Description of the fault, which can be read without the path.
    """

    path: str
    words: str


def faults(
    arrays: Mapping[str, Readable], declarations: Declarations = STANDARD, values: bool = True
) -> Iterator[Fault]:
    """Yield the reasons why an episode is invalid, in the order of the declarations.

    Args:
        arrays: Arrays by dataset path, in memory or on disk. Declared arrays that are not images are read, in blocks.
        declarations: Declarations of the arrays.
        values: Whether numbers are checked, too. If False, only types, shapes and sizes are checked.
    """
    for path, array in arrays.items():
        if not harmless(path):
            yield Fault(
                path, f"{printable(path, 80)!r} is not a name for an array; parts are printable, not empty, . or .."
            )
        if declarations.at(path) is None and not path.startswith(EXTRA):
            yield Fault(
                path,
                f"field {path!r} is not declared; declare it (svfl_data.Field), or record it below {EXTRA}. Standard "
                f"fields are {', '.join(field.path for field in FIELDS)}",
            )
        if path.startswith(EXTRA) and array.dtype.kind not in PLAIN_KINDS:
            yield Fault(path, f"{path} has dtype {array.dtype}; possible are numbers, booleans and byte strings")
    yield from _missing(arrays)
    for camera in camera_names(arrays):
        if not declarations.image_paths(camera, arrays):
            yield Fault(f"cameras/{camera}", f"camera {camera} has no images (color, grey, grey16 or depth)")
    sizes: dict[str, Sizes] = {}
    for group in _groups(arrays):
        fields = {field.path: field for field in declarations.in_group(group)}
        yield from _group_faults(fields, arrays, sizes.setdefault(_scope(group, fields), {}), values)
    steps = sizes.get("", {})
    if {"N+1", "N"} <= steps.keys() and steps["N+1"][0] != steps["N"][0] + 1:
        rows, actions = steps["N+1"][0], steps["N"][0]
        yield Fault(steps["N"][1], f"{rows} observations need {rows - 1} actions, found {actions}")


def _missing(arrays: Mapping[str, Readable]) -> Iterator[Fault]:
    """Yield the arrays without which there are no steps, or that give others their meaning."""
    if OBSERVED not in arrays:
        yield Fault(OBSERVED, f"field {OBSERVED} is missing")
    if not any(path.startswith("actions/") for path in arrays):
        yield Fault("actions", "an episode needs an action of each step, and there is no array below actions/")
    for path in arrays:
        group, _, leaf = path.rpartition("/")
        if leaf == "tare" and group.startswith("streams/") and f"{group}/t_ns" not in arrays:
            yield Fault(f"{group}/t_ns", f"field {group}/t_ns is missing, so {path} belongs to no readings")
        poses = [pose for pose in POSES if f"{group}/{pose}" in arrays]
        if group.startswith("cameras/") and leaf == "t_ns" and len(poses) > 1:
            yield Fault(f"{group}/{poses[1]}", f"{group} has {' and '.join(poses)}; a camera has one pose, or none")
        if group.startswith("cameras/") and leaf == "depth" and f"{group}/depth_scale" not in arrays:
            yield Fault(f"{group}/depth_scale", f"field {group}/depth_scale is missing, so the depth has no unit")


def _groups(arrays: Mapping[str, Readable]) -> list[str]:
    """Return the groups that have arrays, those of standard fields in the order of the declarations and first."""
    found = dict.fromkeys(path.rpartition("/")[0] for path in arrays if not path.startswith(EXTRA))
    standard = [group for group in dict.fromkeys(field.group for field in FIELDS) if group in found]
    return [*standard, *sorted(set(found) - set(standard))]


def _scope(group: str, fields: Mapping[str, Field]) -> str:
    """Return the name of the groups that share their symbols: a camera and an own stream have symbols of their own."""
    return group if group.startswith("cameras/") or any(f.grows and f.shape[0] == "T" for f in fields.values()) else ""


def check_arrays(
    arrays: Mapping[str, Readable], where: str, declarations: Declarations = STANDARD, values: bool = True
) -> None:
    """Raise an error if the arrays make an episode invalid.

    Args:
        arrays: Arrays by dataset path, in memory or on disk.
        where: Name of the episode in the error, such as the file.
        declarations: Declarations of the arrays.
        values: Whether numbers are checked, too. If False, only types, shapes and sizes are checked.

    Raises:
        FieldError: If a field is missing or unknown, has a wrong dtype or shape, disagrees with another field about a
            size, or holds a number that is impossible.
    """
    for fault in faults(arrays, declarations, values):
        raise FieldError(f"{where}: {fault.words}")


def check_array(field: Field, array: np.ndarray, sizes: Sizes, here: str, path: str) -> None:
    """Raise an error if one array does not fit its declaration.

    Args:
        field: Declaration of the array.
        array: Array that is to be stored.
        sizes: Size of each symbol that was found so far. Symbols of this array that are not in it are added.
        here: Start of the error message, such as the file and the path.
        path: Dataset path at which the array is to be stored.

    Raises:
        FieldError: If dtype or shape are not as declared, a size disagrees with that of another array, or a number is
            impossible.
    """
    for words in (*_shape_faults(field, array, sizes, path), *_value_faults(field, array)):
        raise FieldError(f"{here} {words}")


def _group_faults(
    fields: Mapping[str, Field], arrays: Mapping[str, Readable], sizes: Sizes, values: bool
) -> Iterator[Fault]:
    """Yield the faults of the fields of a group."""
    for path, field in fields.items():
        clock = f"{path.rpartition('/')[0]}/t_ns"
        if path in arrays:
            wrong = list(_shape_faults(field, arrays[path], sizes, path))
            if values and not wrong:
                wrong = list(_value_faults(field, arrays[path]))
            yield from (Fault(path, f"field {path} {words}") for words in wrong)
            if clock in fields and clock not in arrays and field.shape[:1] == fields[clock].shape:
                yield Fault(clock, f"field {clock} is missing, so {path} has no times")


def _shape_faults(field: Field, array: Readable, sizes: Sizes, path: str) -> Iterator[str]:
    if array.dtype != field.numpy_dtype:
        yield f"has dtype {array.dtype}, expected {field.dtype}"
    elif len(array.shape) != len(field.shape):
        yield f"has shape {array.shape}, expected {field.shape_words}"
    else:
        for axis, (found, expected) in enumerate(zip(array.shape, field.shape, strict=True)):
            if isinstance(expected, int) and found != expected:
                yield f"has shape {array.shape}, expected {field.shape_words}"
            elif axis and found == 0:  # an image has pixels, an arm has joints
                yield f"has shape {array.shape}: {expected} in {field.shape_words} must be at least 1"
            elif isinstance(expected, str):
                known, owner = sizes.setdefault(expected, (found, path))
                if found != known:
                    other = "its earlier rows have" if owner == path else f"{owner} has"
                    yield f"has {expected} = {found}, but {other} {expected} = {known}"


def _value_faults(field: Field, array: Readable) -> Iterator[str]:
    """Yield at most one fault in the numbers of an array whose shape is right."""
    if array.dtype.kind not in "iufc" or (field.image and array.dtype.kind in "iu"):
        return  # every pixel value is valid
    rule = rule_of(field.path)
    for first, block in _blocks(array):
        wrong = _out_of_bounds(field, block, first) or (rule and rule(block, first))
        if wrong:
            yield wrong
            return


def _blocks(array: Readable) -> Iterator[tuple[int, np.ndarray]]:
    """Yield an array in blocks of rows, each with the number of its first row."""
    if not array.shape:
        yield 0, np.asarray(array)
    elif row := math.prod(array.shape[1:]):
        step = max(1, min(BLOCK_ROWS, BLOCK_NUMBERS // row))
        for first in range(0, array.shape[0], step):
            yield first, np.asarray(array[first : first + step])


def _out_of_bounds(field: Field, values: np.ndarray, first: int) -> str | None:
    low, high = field.possible
    if values.dtype.kind == "c":
        with np.errstate(over="ignore"):
            values = np.abs(values)
    elif values.dtype == np.float16:
        values = values.astype(np.float32)  # in which the bounds are finite
    inside = (values >= low) & (values <= high)  # false for NaN
    if inside.all():
        return None
    place = tuple(int(i) for i in np.argwhere(~inside)[0])
    number = values[place]
    index = f" at index {(place[0] + first, *place[1:])}" if place else ""
    if not math.isfinite(number):
        return f"holds {number}{index}; only finite numbers are stored"
    return f"holds {number:.6g}{index}; possible are {low:.6g} to {high:.6g}"
