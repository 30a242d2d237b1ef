"""What an episode may be made of: the limits of memory, and what the examiner's answer must be to be believed.

Sizes that a file claims decide how much memory it takes to read it, so they are bounded by what it really holds. The
limits leave room for all that is recorded in earnest; a scene that compresses even better is admitted by setting
`VARIABLE`.
"""

import math
import os
import re

import msgspec
import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.fields import EXTRA, field_at
from svfl_data.storage.chunks import FLETCHER, FLETCHER32_BYTES, GZIP, Extent, Placement
from svfl_data.system.printable import printable

VARIABLE = "SVFL_MAX_EXPANSION"
"""Environment variable: how many times its size on disk the arrays of an episode may have in memory."""
NUMBERS_EXPANSION, NUMBERS_FREE = 2.0, 2**26
"""Of the declared arrays that are no images, which are read whole: factor of the file's size, and bytes beside it."""
EXPANSION, FREE = 200.0, 2**28
"""Of all arrays."""
CHUNK = 2**26
"""Bytes of a chunk, such as one image, beside the factor of numbers."""
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
    """What a file holds, as the examiner said.

    Attributes:
        attributes: Of the file.
        problem: Why it is refused as a whole; empty if it is not.
        arrays: Attributes of each array, by path.
    """

    def __init__(self, answer: bytes, extent: Extent) -> None:
        """Take an answer apart.

        Raises:
            FormatError: If it is none.
        """
        head, _, self._tail = answer.partition(b"\n")
        try:
            found = msgspec.json.decode(head, type=_Answer)
        except (msgspec.DecodeError, RecursionError) as error:
            raise FormatError(f"{extent}: not a readable episode (its structure cannot be described)") from error
        self.attributes, self.problem = found.attributes, printable(found.problem)
        self._arrays, self._extent = found.arrays, extent
        self.arrays = {one.path: one.attributes for one in found.arrays}

    def placements(self, size: int) -> dict[str, Placement]:
        """Where each array lies that is declared or the user's own; others come from a later minor version.

        Args:
            size: Bytes of the content in which they must lie.

        Raises:
            FormatError: If one is not what it may be, or they take too much memory.
        """
        found, start = {}, 0
        for one in self._arrays:
            table, value = 24 * one.chunks, one.value
            if one.chunks < 0 or value < 0 or start + table + value > len(self._tail):
                raise self._refused(one.path, "is described wrongly")
            if field_at(one.path) or one.path.startswith(EXTRA):
                if one.problem:
                    raise self._refused(one.path, printable(one.problem))
                if one.in_pieces and field_at(one.path):
                    raise self._refused(one.path, "is stored in pieces of rows; it must be stored in whole rows")
                found[one.path] = self._placement(one, start, size)
            start += table + value
        self._check_memory(found, size)
        return found

    def _placement(self, one: _Array, start: int, size: int) -> Placement:
        """An array that really has the size and the place that it claims."""
        if not DTYPE.fullmatch(one.dtype) or len(one.shape) > 32 or min(one.shape, default=0) < 0:
            raise self._refused(one.path, "is described wrongly")
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
            raise self._refused(one.path, "is described wrongly")
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
            raise self._refused(one.path, "does not lie where it says")
        return Placement(dtype, shape, one.chunk_rows, table)

    def _check_memory(self, placements: dict[str, Placement], size: int) -> None:
        """Refuse what would take more memory than its file is worth."""
        factor = expansion()
        needed = {path: _bytes(placement) for path, placement in placements.items()}
        numbers = {path: count for path, count in needed.items() if (field := field_at(path)) and not field.image}
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
    """Memory that an array takes, with what its last chunk has beyond the last row."""
    rows = len(placement.chunks) * placement.chunk_rows if len(placement.chunks) else math.prod(placement.shape[:1])
    return rows * placement.row_bytes


def _way_on(needed: int, size: int) -> str:
    return f"if you trust it, set {VARIABLE} to {math.ceil(needed / max(1, size))}"


def expansion() -> float | None:
    """The factor that the user has set; None if none.

    Raises:
        UsageError: If it is no number.
    """
    text = os.environ.get(VARIABLE, "")
    try:
        factor = float(text) if text else None
    except ValueError:
        factor = math.nan
    if factor is not None and not 0 <= factor < math.inf:
        raise UsageError(f"{VARIABLE} is {text!r}; it must be a number, such as {EXPANSION:g}")
    return factor
