"""Rules for the rows that may be appended to an episode while it is recorded, and for a whole episode.

Wrong rows are refused before any of their bytes are stored: unknown or missing streams, wrong dtypes and shapes,
streams of one clock with different numbers of rows, images that change their size, and NaN. The rules for time stamps
are in `svfl_data.recording.recording_clocks`.
"""

from collections.abc import Mapping

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.fields import EXTRA, FIELDS, PLAIN_KINDS, harmless
from svfl_data.schema.validity import check_array, check_arrays
from svfl_data.system.printable import printable


def check_constants(constants: Mapping[str, np.ndarray], declarations: Declarations = STANDARD) -> None:
    """Check the constants of an episode, which are the arrays that it has once.

    Args:
        constants: Constants by dataset path.
        declarations: Declarations of the episode's arrays.

    Raises:
        FieldError: If a constant is not declared, has rows that must be appended, or does not fit its declaration.
    """
    sizes: dict[str, dict[str, tuple[int, str]]] = {}
    for path, array in constants.items():
        field = declarations.at(path)
        if field is None and path.startswith(EXTRA):
            _check_own(path, array)
        elif field is None or field.grows:
            raise FieldError(f"constant {path!r}: {'has rows, append it' if field else NOT_DECLARED}; {_known(None)}")
        else:
            check_array(field, array, sizes.setdefault(field.group, {}), f"constant {path}", path)


NOT_DECLARED = "is not declared (declare it with svfl_data.Field, or record it below extra/)"
ROW_COUNTS = {"rows", "T", *(field.shape[0] for field in FIELDS if field.grows)}
"""Symbols of sizes that differ between appends. All other sizes, such as the height of images, must not change."""


class Growth:
    """Types and shapes of the streams of one episode that is being recorded.

    Args:
        constants: Arrays that the episode has once, by dataset path.
        declarations: Declarations of the episode's arrays.
    """

    def __init__(self, constants: Mapping[str, np.ndarray], declarations: Declarations = STANDARD) -> None:
        self._constants, self._declarations = constants, declarations
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
            self._check_rows(path, array, sizes)
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
            self._check_rows(path, array, sizes)
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
        for field in self._declarations.own:
            if field.grows and not rows.get(field.path):
                raise FieldError(f"{where}: field {field.path} was declared, but nothing was appended to it")
        streams = {
            path: np.broadcast_to(np.zeros((), dtype), (rows[path], *row_shape))
            for columns in self._columns.values()
            for path, (dtype, row_shape) in columns.items()
            if path in rows
        }
        arrays = {**self._constants, **late, **streams}
        check_arrays(arrays, where, self._declarations, values=False)  # values were checked when they came

    def _check_group(self, group: str, columns: Mapping[str, object]) -> None:
        """Check that the first rows of a group have a clock, and images a camera's constants that give them meaning."""
        clock = f"{group}/t_ns"
        if self._declarations.at(clock) and clock not in columns:
            raise FieldError(f"{group}: {clock} is missing")
        if (
            f"{group}/depth" in columns
            and group.startswith("cameras/")
            and f"{group}/depth_scale" not in self._constants
        ):
            raise FieldError(f"{group}: constant {group}/depth_scale is missing, so the depth has no unit")

    def _check_rows(self, path: str, array: np.ndarray, sizes: dict[str, tuple[int, str]]) -> None:
        field = self._declarations.at(path)
        if field is not None and field.grows:
            check_array(field, array, sizes, path, path)
        elif field is None and path.startswith(EXTRA):
            _check_own(path, array)
            count, owner = sizes.setdefault("rows", (len(array) if array.ndim else 0, path))
            if array.ndim == 0 or len(array) != count:
                raise FieldError(f"{path} has shape {array.shape}, expected {count} rows as {owner}")
        else:
            raise FieldError(f"{path}: {'is a constant' if field else NOT_DECLARED}; {_known(path)}")


def _check_own(path: str, array: np.ndarray) -> None:
    if not harmless(path):
        raise FieldError(f"{printable(path)}: not a name for an array; parts are printable, not empty and not . or ..")
    if array.dtype.kind not in PLAIN_KINDS:
        raise FieldError(f"{path} has dtype {array.dtype}; numbers, booleans and byte strings can be recorded")


def _known(path: str | None) -> str:
    wanted = [field.path for field in FIELDS if field.grows == (path is not None)]
    return f"standard fields are {', '.join(wanted)}"


def _words(columns: Mapping[str, tuple[np.dtype, tuple[int, ...]]]) -> str:
    return ", ".join(f"{path} {dtype} {shape}" for path, (dtype, shape) in columns.items())
