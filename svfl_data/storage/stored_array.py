"""Arrays of an episode on disk, whose rows are read when they are asked for."""

import math
import operator
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.schema.field import Field
from svfl_data.storage.chunks import Extent, Placement


@dataclass(frozen=True, eq=False)
class StoredArray:
    """An array of an episode on disk, whose rows are read by indexing the object.

    Attributes:
        path: Dataset path of the array in the episode.
        extent: Place of the episode: its file and the range of bytes in it.
        placement: Type, shape and place of the array inside the episode.
        field: Declaration of the array; None below ``extra/``.
    """

    path: str
    extent: Extent
    placement: Placement
    field: Field | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.placement.shape

    @property
    def dtype(self) -> np.dtype:
        """NumPy dtype of the elements."""
        return self.placement.dtype

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def unit(self) -> str:
        """Unit of the numbers; ``-`` if they have none or the array is not declared."""
        return self.field.unit if self.field else "-"

    def __getitem__(self, rows: int | slice | tuple[()] | Sequence[int] | np.ndarray) -> np.ndarray:
        """Read one row, a range of rows, several chosen rows, or (with ``[()]`` or ``[:]``) the whole array.

        Raises:
            IndexError: If the array does not have a requested row.
            FormatError: If the file has changed since it was found, or cannot be read.
        """
        if not self.shape:
            return np.asarray(self.placement.value)
        if isinstance(rows, tuple) and not rows:
            rows = slice(None)
        if isinstance(rows, slice):
            start, stop, stride = rows.indices(len(self))
            return self.rows(start, max(start, stop))[::stride] if stride > 0 else self.rows(0, len(self))[rows]
        if not isinstance(rows, slice) and np.ndim(rows):
            found = [self[int(row)] for row in np.arange(len(self))[np.asarray(rows)]]
            return np.stack(found) if found else np.empty((0, *self.shape[1:]), self.dtype)
        row = operator.index(rows)  # type: ignore[arg-type] # an index without dimensions is one row
        row += len(self) if row < 0 else 0
        if not 0 <= row < len(self):
            raise IndexError(f"{self.path} of {self.extent}: no row {rows}; it has {len(self)}")
        return self.rows(row, row + 1)[0]

    def rows(self, start: int, stop: int) -> np.ndarray:
        """Read the rows start .. stop-1, which must lie within the array."""
        descriptor = self.extent.open()
        try:
            return self.placement.rows(self.extent, descriptor, start, stop)
        finally:
            os.close(descriptor)

    def __iter__(self) -> Iterator[np.ndarray]:
        """Read the rows one after the other, with one row in memory at a time."""
        return (self[row] for row in range(len(self)))

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[()], dtype=dtype)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"StoredArray({self.path}, {self.dtype} {self.shape}, {self.unit})"
