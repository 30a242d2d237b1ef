"""Everything that an episode declares and that has no drawing of its own: curves, pictures over time, and texts.

What is drawn, and how, follows from the declaration of an array alone, so that fields of the user's own are shown with
the names and units of their components.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr

from svfl_data.schema.field import Field
from svfl_data.schema.field_words import by_unit, clock_of, is_wrench, labels, title
from svfl_data.storage.stored_array import StoredArray
from svfl_data.system.printable import printable
from svfl_data.viewer.entities.cameras import EXACT_BYTES
from svfl_data.viewer.entities.episode_source import ACTION, PROPRIO, TARE, WRENCH, EpisodeSource
from svfl_data.viewer.entities.images import send_images
from svfl_data.viewer.entities.names import AXES, CURVES, FIELDS, send
from svfl_data.viewer.entities.plots import send_curve

MOST_CURVES = 16
"""Largest number of numbers of a row that are drawn as curves; larger rows are drawn as pictures."""
MOST_VIEWS = 100
"""Largest number of views of one episode; with thousands the viewer terminates."""
MOST_PICTURES = 5000
"""Largest number of pictures of a field; of more rows, evenly chosen ones are drawn."""
LONGEST_TEXT = 2000
ROWS_AT_ONCE, BLOCK_ROWS = 2**16, 256

Kind = Literal["curves", "pictures", "map", "images", "text"]


@dataclass(frozen=True)
class FieldView:
    """One view of a field.

    Attributes:
        path: Dataset path of the array.
        entity: Entity of the view.
        name: Name of the array with its unit, such as ``tactile/pressure, kPa``.
        kind: How the array is drawn: ``curves`` over time, a picture per row (``pictures``), one picture with the rows
            along its width (``map``), ``images``, or ``text``.
        names: Names of the curves, with units.
        columns: Which numbers of a row are drawn as curves.
        tare: Dataset path of the offset that is subtracted; empty for none.
    """

    path: str
    entity: str
    name: str
    kind: Kind
    names: tuple[str, ...] = ()
    columns: tuple[int, ...] = ()
    tare: str = ""


def field_views(shown: EpisodeSource) -> list[FieldView]:
    """Return the views of all fields with rows that have no drawing of their own: first actions, then wrenches.

    Args:
        shown: Episode that is shown.
    """
    return _all_views(shown)[:MOST_VIEWS]


def left_out(shown: EpisodeSource) -> int:
    """Return how many fields of an episode are not drawn because there are more than `MOST_VIEWS` views.

    Args:
        shown: Episode that is shown.
    """
    return len({view.path for view in _all_views(shown)[MOST_VIEWS:]})


def _all_views(shown: EpisodeSource) -> list[FieldView]:
    def place(path: str) -> tuple[bool, bool, str]:
        return not path.startswith("actions/"), not is_wrench(shown.declarations.at(path)), path

    paths = sorted(shown.arrays, key=place)
    return [view for path in paths if _is_shown(shown, path) for view in _views(shown, path)]


def _is_shown(shown: EpisodeSource, path: str) -> bool:
    field, array = shown.declarations.at(path), shown.arrays[path]
    drawn = {PROPRIO, WRENCH, TARE} | ({ACTION} if shown.planar else set())
    if field is None or not field.grows or path in drawn or path.endswith(("/t_ns", "/T_base_camera_per_frame")):
        return False
    return len(array.shape) > 0 and 0 not in array.shape and not (field.image and path.startswith("cameras/"))


def _views(shown: EpisodeSource, path: str) -> Iterator[FieldView]:
    field, array, tare = shown.declarations.at(path), shown.arrays[path], f"{path.rpartition('/')[0]}/tare"
    assert field is not None
    has_tare = tare in shown and shown.arrays[tare].shape == (6,)
    return views_of(field, path, tuple(array.shape[1:]), shown.root, tare if has_tare else "")


def views_of(field: Field, path: str, row: tuple[int, ...], root: str = "", tare: str = "") -> Iterator[FieldView]:
    """Yield the views of one field with rows.

    Args:
        field: Declaration of the array.
        path: Dataset path of the array.
        row: Shape of a row.
        root: Prefix of the episode's entities.
        tare: Dataset path of the offset of a wrench; empty for none.
    """
    entity = "/".join([root + FIELDS, *(rr.escape_entity_path_part(part) for part in path.split("/"))])
    whole = title(field)
    if np.dtype(field.dtype).kind == "S":
        yield FieldView(path, entity, whole, "text")
    elif field.image:
        yield FieldView(path, entity, whole, "images")
    elif int(np.prod(row)) > MOST_CURVES:
        yield FieldView(path, entity, whole, "pictures" if len(row) > 1 else "map")
    elif is_wrench(field):
        yield from _wrench(field, entity, tare)
    else:
        words, units = labels(field, row), by_unit(field, row)
        for number, (unit, columns) in enumerate(units.items()):
            bare = whole.partition(",")[0]
            name = whole if len(units) == 1 else f"{bare}, {unit}" if unit else bare
            place = entity if len(units) == 1 else f"{entity}/unit_{number}"
            yield FieldView(path, place, name, "curves", tuple(words[column] for column in columns), tuple(columns))


def _wrench(field: Field, entity: str, tare: str) -> Iterator[FieldView]:
    """Yield force and torque of a further wrench sensor, tared if it has a tare, and then also its raw readings."""
    words = labels(field, (6,))
    group = printable(field.group.removeprefix("streams/"))
    for offset, adjective in ((tare, "tared "), ("", "raw ")) if tare else (("", "raw "),):
        for word, unit, first in (("force", "N", 0), ("torque", "N m", 3)):
            columns = tuple(range(first, first + 3))
            names = tuple(adjective * (not offset) + words[column] for column in columns)
            place = f"{entity}/{word}" if offset or not tare else f"{entity}/raw_{word}"
            yield FieldView(field.path, place, f"{group}: {adjective}{word}, {unit}", "curves", names, columns, offset)


def log_fields(recording: rr.RecordingStream, shown: EpisodeSource) -> list[FieldView]:
    """Log all fields that have no drawing of their own.

    Args:
        recording: Recording to log to.
        shown: Episode that is shown.

    Returns:
        The views, for the layout of the window.
    """
    views = field_views(shown)
    for view in views:
        t_ns = shown[clock_of(view.path)][: shown.arrays[view.path].shape[0]]
        {"curves": _curves, "pictures": _pictures, "map": _map, "images": _images, "text": _text}[view.kind](
            recording, shown, view, t_ns
        )
        recording.flush()
    return views


def curve_colors(view: FieldView) -> Sequence[tuple[int, int, int]]:
    """Return the colours of the curves of a view, in their order."""
    return AXES if len(view.columns) == 3 else CURVES[: len(view.columns)]


def log_curve_style(recording: rr.RecordingStream, view: FieldView) -> None:
    """Log names, colours and widths of the curves of a view.

    Args:
        recording: Recording to log to.
        view: View that is drawn as curves.
    """
    commanded = view.path.startswith("actions/")
    held: Literal["StepAfter", "Linear"] = "StepAfter" if commanded else "Linear"
    width = 2.5 if commanded else 1.5
    lines = rr.SeriesLines(names=view.names, colors=curve_colors(view), widths=width, interpolation_mode=held)
    recording.log(view.entity, lines, static=True)


def _curves(recording: rr.RecordingStream, shown: EpisodeSource, view: FieldView, t_ns: np.ndarray) -> None:
    log_curve_style(recording, view)
    offset = shown[view.tare] if view.tare else np.zeros(1)
    for first in range(0, len(t_ns), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        values = _numbers(np.asarray(shown.arrays[view.path][rows])).reshape(len(t_ns[rows]), -1) - offset
        send_curve(recording, view.entity, t_ns[rows], values[:, list(view.columns)])


def _pictures(recording: rr.RecordingStream, shown: EpisodeSource, view: FieldView, t_ns: np.ndarray) -> None:
    """Log rows of several axes as pictures; rows of more than two axes as the pictures of their last two, in a line."""
    array = shown.arrays[view.path]
    rows = _chosen(len(t_ns), max(1, EXACT_BYTES // max(1, 8 * int(np.prod(array.shape[1:])))))
    values = np.stack([tiled(row) for row in _read(array, rows)]).astype(np.float32)
    log_range(recording, view.entity, values)
    for row, picture in zip(rows, values, strict=True):  # columns take a stack of pictures for one tensor
        send(recording, view.entity, t_ns[row : row + 1], rr.Tensor.columns(data=picture))


def tiled(row: np.ndarray) -> np.ndarray:
    """Return a row of at least two axes as one picture: the pictures of its last two axes, in a line with gaps.

    Args:
        row: Numbers of the row, shape (..., H, W).

    Returns:
        The picture, shape (H, W) or (H, pictures * (W + 1) - 1).
    """
    pictures = row.reshape(-1, *row.shape[-2:])
    gap = np.full((row.shape[-2], 1), pictures.min())
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


def _map(recording: rr.RecordingStream, shown: EpisodeSource, view: FieldView, t_ns: np.ndarray) -> None:
    array, rows = shown.arrays[view.path], _chosen(len(t_ns), MOST_PICTURES)
    values = np.stack(list(_read(array, rows))).astype(np.float32).T
    log_range(recording, view.entity, values)
    recording.log(view.entity, rr.Tensor(values, dim_names=("component", "row")), static=True)


def _images(recording: rr.RecordingStream, shown: EpisodeSource, view: FieldView, t_ns: np.ndarray) -> None:
    array = shown.arrays[view.path]
    small = int(np.prod(array.shape)) * array.dtype.itemsize > EXACT_BYTES
    for first in range(0, len(t_ns), BLOCK_ROWS):
        rows = slice(first, first + BLOCK_ROWS)
        send_images(recording, view.entity, t_ns[rows], np.asarray(array[rows]), small)


def _text(recording: rr.RecordingStream, shown: EpisodeSource, view: FieldView, t_ns: np.ndarray) -> None:
    rows = np.asarray(shown.arrays[view.path][: len(t_ns)]).reshape(len(t_ns), -1)
    said = [", ".join(printable(one.decode(errors="replace"), LONGEST_TEXT) for one in row) for row in rows]
    send(recording, view.entity, t_ns, rr.TextLog.columns(text=said, level=["INFO"] * len(said)))


def log_range(recording: rr.RecordingStream, entity: str, values: np.ndarray) -> None:
    """Log the range of the finite values of a picture, which its colours cover.

    Args:
        recording: Recording to log to.
        entity: Entity of the picture.
        values: Values of all pictures of the entity, any shape.
    """
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    tensor = rr.Tensor.from_fields(value_range=[low, high if high > low else low + 1.0])
    recording.log(entity, tensor, static=True)


def _chosen(count: int, most: int) -> np.ndarray:
    """Return all rows, or evenly chosen ones if there are more than `most`."""
    return np.unique(np.linspace(0, count - 1, min(count, most, MOST_PICTURES)).round().astype(np.int64))


def _read(array: np.ndarray | StoredArray, rows: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the chosen rows of an array as numbers; the array is read in blocks, because its chunks hold many rows."""
    for first in range(0, len(rows), BLOCK_ROWS):
        block = rows[first : first + BLOCK_ROWS]
        if block[-1] - block[0] < 4 * len(block):
            yield from _numbers(np.asarray(array[int(block[0]) : int(block[-1]) + 1]))[block - block[0]]
        else:
            yield from (_numbers(np.asarray(array[int(row)])) for row in block)


def _numbers(values: np.ndarray) -> np.ndarray:
    """Return numbers as float64; complex ones by their magnitude."""
    return (np.abs(values) if values.dtype.kind == "c" else values).astype(np.float64)
