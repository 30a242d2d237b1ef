"""Limits of the memory that an episode may take, and checks of the examiner's answer about a file.

The sizes that a file claims decide how much memory it takes to read it, so these sizes are bounded by the real size of
the file. The limits leave room for all ordinary recordings. A recording that compresses even better is admitted if the
user sets the environment variable named by `VARIABLE`.
"""

import math
import os
import re
from collections.abc import Container

import msgspec
import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.declarations import Declarations, stored_declarations
from svfl_data.schema.fields import EXTRA
from svfl_data.storage.chunks import FLETCHER, FLETCHER32_BYTES, GZIP, Extent, Placement
from svfl_data.system.printable import printable

VARIABLE = "SVFL_MAX_EXPANSION"
"""Name of the environment variable that sets the largest ratio of an episode's size in memory to its size on disk."""
NUMBERS_EXPANSION, NUMBERS_FREE = 2.0, 2**26
"""Memory limit of the declared arrays that are not images, which are read whole: the file's size times the factor
`NUMBERS_EXPANSION`, plus `NUMBERS_FREE` bytes."""
EXPANSION, FREE = 200.0, 2**28
"""Memory limit of all arrays together: the file's size times the factor `EXPANSION`, plus `FREE` bytes."""
CHUNK = 2**26
"""Memory limit of one chunk, such as one image: `CHUNK` bytes plus the file's size times `NUMBERS_EXPANSION`."""
DTYPE = re.compile(r"[<>|][biufcS][0-9]{1,5}")


class _Array(msgspec.Struct):
    path: str
    problem: str = ""
    attributes: dict[str, str | int | float | bool] = {}
    dtype: str = ""
    shape: list[int] = []
    chunk_rows: int = 1
    chunks: int = 0
    value: int = 0
    in_pieces: bool = False


class _Answer(msgspec.Struct):
    attributes: dict[str, str | int | float | bool]
    problem: str
    arrays: list[_Array]


class Description:
    """Content of a file as the examiner described it.

    Attributes:
        attributes: Attributes of the file, by name.
        problem: Reason for which the whole file is refused; empty if there is none.
        arrays: Attributes of each array, by dataset path.

    Args:
        answer: Answer of the examiner (`svfl_data.storage.examiner.examine`).
        extent: Place of the episode, for messages.
    """

    def __init__(self, answer: bytes, extent: Extent) -> None:
        """Parse the answer.

        Raises:
            FormatError: If the answer cannot be parsed.
        """
        head, _, self._tail = answer.partition(b"\n")
        try:
            found = msgspec.json.decode(head, type=_Answer)
        except (msgspec.DecodeError, RecursionError) as error:
            raise FormatError(f"{extent}: not a readable episode (its structure cannot be described)") from error
        self.attributes, self.problem = found.attributes, printable(found.problem)
        self._arrays, self._extent = found.arrays, extent
        self.arrays = {one.path: one.attributes for one in found.arrays}

    def declarations(self) -> Declarations:
        """Return the declarations of the arrays.

        Raises:
            FieldError: If an array outside ``extra/`` is not declared, or a declaration contradicts itself or a
                standard field.
        """
        return stored_declarations({one.path: (self._dtype(one), one.attributes) for one in self._arrays})

    def placements(self, size: int, declarations: Declarations, left_out: Container[str] = ()) -> dict[str, Placement]:
        """Return the placement of each array, by dataset path.

        Args:
            size: Size of the content in which the arrays must lie, [bytes].
            declarations: Declarations of the arrays.
            left_out: Dataset paths of arrays that are not wanted, whatever they are.

        Raises:
            FormatError: If an array is of a kind that is not allowed, or the arrays take too much memory.
        """
        found, start = {}, 0
        for one in self._arrays:
            table, value = 24 * one.chunks, one.value
            if one.chunks < 0 or value < 0 or start + table + value > len(self._tail):
                raise self._refused(one.path, "has a damaged description (shape, type or chunks)")
            if one.path not in left_out:
                if one.problem:
                    raise self._refused(one.path, printable(one.problem))
                if one.in_pieces and not one.path.startswith(EXTRA):
                    raise self._refused(one.path, "is stored in pieces of rows; it must be stored in whole rows")
                found[one.path] = self._placement(one, start, size)
            start += table + value
        self._check_memory(found, size, declarations)
        return found

    def _dtype(self, one: _Array) -> str:
        if one.problem:
            raise self._refused(one.path, printable(one.problem))
        if not DTYPE.fullmatch(one.dtype):
            raise self._refused(one.path, "has a damaged description (shape, type or chunks)")
        dtype = np.dtype(one.dtype)
        return dtype.str if dtype.kind == "S" else str(dtype)

    def _placement(self, one: _Array, start: int, size: int) -> Placement:
        """Return the placement of an array after checking that its size and place are those that it claims."""
        if not DTYPE.fullmatch(one.dtype) or len(one.shape) > 32 or min(one.shape, default=0) < 0:
            raise self._refused(one.path, "has a damaged description (shape, type or chunks)")
        dtype, shape = np.dtype(one.dtype), tuple(one.shape)
        if math.prod(filter(None, shape)) > 2**48:
            raise self._refused(one.path, f"claims the shape {shape}")
        table = np.frombuffer(self._tail, np.int64, 3 * one.chunks, start).reshape(-1, 3)
        if not one.chunks:
            if dtype.itemsize * math.prod(shape) != one.value:
                raise self._refused(one.path, "does not have the bytes that its shape needs")
            content = bytes(self._tail[start : start + one.value])
            value = np.frombuffer(content, np.uint8) != 0 if dtype.kind == "b" else np.frombuffer(content, dtype)
            return Placement(dtype, shape, 1, table, value.reshape(shape))
        whole = one.chunk_rows * dtype.itemsize * math.prod(shape[1:])
        if not shape or one.chunk_rows < 1 or whole < 1 or one.chunks != -(-shape[0] // one.chunk_rows):
            raise self._refused(one.path, "has a damaged description (shape, type or chunks)")
        factor = expansion()
        allowed = int(CHUNK + (NUMBERS_EXPANSION if factor is None else factor) * size)
        if whole > allowed:
            raise self._refused(
                one.path,
                f"has chunks of {whole} bytes, {allowed} are allowed for a file of {size}; {_way_on(whole, size)}",
            )
        offset, length, applied = table.T
        plain = np.full(one.chunks, whole)
        if not applied[-1]:
            plain[-1] -= (one.chunks * one.chunk_rows - shape[0]) * (whole // one.chunk_rows)
        content = length - FLETCHER32_BYTES * (applied & FLETCHER != 0)
        inside = (offset >= 0) & (content > 0) & (offset <= size) & (length <= size - offset)
        if not (inside & ((applied & GZIP != 0) | (content >= plain))).all():
            raise self._refused(one.path, "has chunks that lie outside the file, or are smaller than its shape needs")
        return Placement(dtype, shape, one.chunk_rows, table)

    def _check_memory(self, placements: dict[str, Placement], size: int, declarations: Declarations) -> None:
        """Refuse arrays that would take more memory than the limits allow for a file of this size."""
        factor = expansion()
        needed = {path: _bytes(placement) for path, placement in placements.items()}
        numbers = {path: count for path, count in needed.items() if (f := declarations.at(path)) and not f.large}
        for counts, what, usual, free in (
            (numbers, "numbers", NUMBERS_EXPANSION, NUMBERS_FREE),
            (needed, "arrays", EXPANSION, FREE),
        ):
            allowed = int(free + (usual if factor is None else factor) * size)
            if sum(counts.values()) > allowed:
                largest = max(counts, key=lambda path: counts[path])
                raise FormatError(
                    f"{self._extent}: its {what} would take {sum(counts.values())} bytes of memory (most of them "
                    f"{largest}), {allowed} are allowed for a file of {size}; {_way_on(sum(counts.values()), size)}"
                )

    def _refused(self, path: str, why: str) -> FormatError:
        return FormatError(f"{self._extent}: {path} {why}")


def _bytes(placement: Placement) -> int:
    """Return the memory that an array takes, [bytes], including the unused rest of its last chunk."""
    rows = len(placement.chunks) * placement.chunk_rows if len(placement.chunks) else math.prod(placement.shape[:1])
    return rows * placement.row_bytes


def _way_on(needed: int, size: int) -> str:
    return f"if you trust it, set {VARIABLE} to {math.ceil(needed / max(1, size))}"


def expansion() -> float | None:
    """Return the factor that the user has set in the environment variable `VARIABLE`; None if it is not set.

    Raises:
        UsageError: If the variable is not a non-negative, finite number.
    """
    text = os.environ.get(VARIABLE, "")
    try:
        factor = float(text) if text else None
    except ValueError:
        factor = math.nan
    if factor is not None and not 0 <= factor < math.inf:
        raise UsageError(f"{VARIABLE} is {text!r}; it must be a number, such as {EXPANSION:g}")
    return factor
