"""Rules for the rows that may be appended to an episode while it is recorded, and for a whole episode.

Wrong rows are refused before any of their bytes are stored: unknown or missing streams, wrong dtypes and shapes,
streams of one clock with different numbers of rows, images that change their size, and NaN. The rules for time stamps
are in `svfl_data.recording.recording_clocks`.
"""

from collections.abc import Mapping

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.fields import CAMERA, EXTRA, FIELDS, PLAIN_KINDS, Field, camera_names, field_at, harmless
from svfl_data.schema.validity import check_array, check_arrays
from svfl_data.system.printable import printable


def grows(field: Field) -> bool:
    """Return whether a field has a row per reading, rather than one value per episode."""
    return bool(field.shape) and isinstance(field.shape[0], str)


def check_constants(constants: Mapping[str, np.ndarray], required: bool = True) -> None:
    """Check the constants of an episode, which are the arrays that it has once.

    Args:
        constants: Constants by dataset path.
        required: Whether all constants that an episode must have must be present: workspace, tare, and the calibration
            of its cameras.

    Raises:
        FieldError: If a constant is missing, is unknown, has rows that must be appended, or does not fit its
            declaration.
    """
    for path, array in constants.items():
        field = field_at(path)
        if field is None and path.startswith(EXTRA):
            _check_own(path, array)
        elif field is None or grows(field):
            raise FieldError(f"constant {path!r}: {'has rows, append it' if field else 'unknown'}; {_known(None)}")
        else:
            check_array(field, array, {}, f"constant {path}", path)
    for path in _paths(camera_names(constants)) if required else ():
        field = field_at(path)
        if field and not grows(field) and not field.optional and path not in constants:
            raise FieldError(f"constant {path} is missing; it must be known before the first reading is stored")


ROW_COUNTS = {"rows", *(field.shape[0] for field in FIELDS if grows(field))}
"""Symbols of sizes that differ between appends. All other sizes, such as the height of images, must not change."""


class Growth:
    """Types and shapes of the streams of one episode that is being recorded.

    Args:
        constants: Arrays that the episode has once, by dataset path.
    """

    def __init__(self, constants: Mapping[str, np.ndarray]) -> None:
        self._constants = constants
        self._columns: dict[str, dict[str, tuple[np.dtype, tuple[int, ...]]]] = {}
        self._sizes: dict[str, dict[str, tuple[int, str]]] = {}

    def check(self, group: str, arrays: Mapping[str, np.ndarray]) -> bool:
        """Check rows that are to be appended to a group.

        Args:
            group: Group of streams that share a clock, e.g. ``streams/wrench`` or ``cameras/front``.
            arrays: Rows of each stream, by dataset path.

        Returns:
            Whether these are the first rows of the group.

        Raises:
            FieldError: If the rows do not fit their declarations or the first rows of the group, or a stream or
                constant that the group needs is missing.
        """
        sizes = dict(self._sizes.get(group, {}))
        for path, array in arrays.items():
            _check_rows(path, array, sizes)
        columns = {path: (array.dtype, array.shape[1:]) for path, array in arrays.items()}
        first = group not in self._columns
        if first:
            self._check_group(group, columns)
        elif (before := self._columns[group]) != columns:
            raise FieldError(f"{group}: has {_words(columns)}, but began with {_words(before)}")
        return first

    def begin(self, group: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Remember types and shapes of the first rows of a group, with which all later rows must agree."""
        sizes: dict[str, tuple[int, str]] = {}
        for path, array in arrays.items():
            _check_rows(path, array, sizes)
        self._sizes[group] = {symbol: size for symbol, size in sizes.items() if symbol not in ROW_COUNTS}
        self._columns[group] = {path: (array.dtype, array.shape[1:]) for path, array in arrays.items()}

    def check_whole(self, rows: Mapping[str, int], late: Mapping[str, np.ndarray], where: str) -> None:
        """Check that the streams and constants form a whole episode.

        Args:
            rows: Number of rows of each stream, by dataset path.
            late: Constants that were only given at the end, by dataset path.
            where: Name of the episode for the error message.

        Raises:
            FieldError: If a stream is missing or streams disagree about their length.
        """
        streams = {
            path: np.broadcast_to(np.zeros((), dtype), (rows[path], *row_shape))
            for columns in self._columns.values()
            for path, (dtype, row_shape) in columns.items()
            if path in rows
        }
        check_arrays({**self._constants, **late, **streams}, where, values=False)  # values were checked when they came

    def _check_group(self, group: str, columns: Mapping[str, object]) -> None:
        camera = group.partition("/")[2]
        for path in _paths([camera] if group.startswith("cameras/") else []):
            field = field_at(path)
            if field is None or path.rpartition("/")[0] != group:
                continue
            if grows(field) and path not in columns and (not field.optional or path.endswith("/t_ns")):
                raise FieldError(f"{group}: {path} is missing")
            if not grows(field) and path not in self._constants and not field.optional:
                raise FieldError(f"{group}: constant {path} is missing")


def _check_rows(path: str, array: np.ndarray, sizes: dict[str, tuple[int, str]]) -> None:
    field = field_at(path)
    if field is not None and grows(field):
        check_array(field, array, sizes, path, path)
    elif field is None and path.startswith(EXTRA):
        _check_own(path, array)
        count, owner = sizes.setdefault("rows", (len(array) if array.ndim else 0, path))
        if array.ndim == 0 or len(array) != count:
            raise FieldError(f"{path} has shape {array.shape}, expected {count} rows as {owner}")
    else:
        raise FieldError(f"{path}: {'is a constant' if field else 'unknown stream'}; {_known(path)}")


def _check_own(path: str, array: np.ndarray) -> None:
    if not harmless(path):
        raise FieldError(f"{printable(path)}: not a name for an array; parts are printable, not empty and not . or ..")
    if array.dtype.kind not in PLAIN_KINDS:
        raise FieldError(f"{path} has dtype {array.dtype}; numbers, booleans and byte strings can be recorded")


def _paths(cameras: list[str]) -> list[str]:
    """Return the dataset paths of all declared fields, with those of the given cameras."""
    whole = [field.path for field in FIELDS if CAMERA not in field.path]
    return whole + [f.path.replace(CAMERA, camera) for camera in cameras for f in FIELDS if CAMERA in f.path]


def _known(path: str | None) -> str:
    wanted = [field.path for field in FIELDS if grows(field) == (path is not None)]
    return f"there is {', '.join(wanted)} and anything below {EXTRA}"


def _words(columns: Mapping[str, tuple[np.dtype, tuple[int, ...]]]) -> str:
    return ", ".join(f"{path} {dtype} {shape}" for path, (dtype, shape) in columns.items())
