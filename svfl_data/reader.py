"""Lazy reading of one episode: shapes at once, numbers only when asked for.

The seal is checked when an episode is first opened in a process; from then on its bytes are read by `pread` at known
places (`svfl_data.chunks`), and refused if the file has changed meanwhile. A reader holds no open file: it can be
copied, pickled, and carried through a fork.
"""

import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.chunks import Extent, Placement, pread
from svfl_data.episode import Episode, Meta
from svfl_data.errors import FieldError, FormatError
from svfl_data.fields import EXTRA, camera_names, field_at, is_image
from svfl_data.header import header, read_meta
from svfl_data.seal import SEAL_MARK, SEAL_SIZE


@dataclass(frozen=True, eq=False)
class StoredArray:
    """An array of an episode on disk; index it to read.

    Attributes:
        path: Its name in the episode.
        extent: The episode.
        placement: Where it lies.
    """

    path: str
    extent: Extent
    placement: Placement

    @property
    def shape(self) -> tuple[int, ...]:
        """Its sizes."""
        return self.placement.shape

    @property
    def dtype(self) -> np.dtype:
        """Type of its elements."""
        return self.placement.dtype

    @property
    def unit(self) -> str:
        """Unit of its numbers, ``-`` for none or unknown."""
        field = field_at(self.path)
        return field.unit if field else "-"

    def __getitem__(self, rows: int | slice | tuple[()]) -> np.ndarray:
        """Read one row, a range of rows, or (with ``[()]`` or ``[:]``) everything.

        Raises:
            IndexError: If there is no such row.
            FormatError: If the file has changed or cannot be read.
        """
        if not self.shape:
            return np.asarray(self.placement.value)
        if isinstance(rows, tuple):
            rows = slice(None)
        if isinstance(rows, slice):
            start, stop, stride = rows.indices(len(self))
            return self.rows(start, max(start, stop))[::stride] if stride > 0 else self.rows(0, len(self))[rows]
        row = rows + len(self) if rows < 0 else rows
        if not 0 <= row < len(self):
            raise IndexError(f"{self.path} of {self.extent}: no row {rows}; it has {len(self)}")
        return self.rows(row, row + 1)[0]

    def rows(self, start: int, stop: int) -> np.ndarray:
        """Rows start .. stop-1, both within the array."""
        descriptor = self.extent.open()
        try:
            return self.placement.rows(self.extent, descriptor, start, stop)
        finally:
            os.close(descriptor)

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[()], dtype=dtype)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"StoredArray({self.path}, {self.dtype} {self.shape}, {self.unit})"


@dataclass(frozen=True)
class EpisodeReader:
    """An episode on disk; nothing is read before it is asked for, as in ``reader["streams/wrench/wrench"][-64:]``.

    Attributes:
        extent: Where it lies.
    """

    extent: Extent

    @classmethod
    def of_file(cls, file: Path | str) -> "EpisodeReader":
        """The episode of a file of its own.

        Raises:
            FormatError: If there is no such file.
        """
        return cls(Extent.of_file(Path(file)))

    @property
    def seal(self) -> str:
        """SHA-256 of the episode's content, in hexadecimal: equal for equal episodes."""
        return header(self.extent).seal

    @property
    def written_seal(self) -> str:
        """The seal as it stands in the file, read without checking it.

        Raises:
            FormatError: If the episode has none.
        """
        descriptor = self.extent.open()
        try:
            tail = pread(self.extent, descriptor, SEAL_SIZE, self.extent.size - SEAL_SIZE)
        finally:
            os.close(descriptor)
        if not tail.startswith(SEAL_MARK):
            raise FormatError(f"{self.extent}: not a sealed episode")
        return tail[len(SEAL_MARK) : -1].decode(errors="replace")

    @property
    def format_version(self) -> str:
        """Version of the format it was written in."""
        return str(header(self.extent).attributes["format_version"])

    @functools.cached_property
    def meta(self) -> Meta:
        """What the episode is about."""
        return read_meta(self.extent)

    @property
    def paths(self) -> list[str]:
        """Dataset paths of its arrays."""
        return list(header(self.extent).placements)

    @property
    def cameras(self) -> list[str]:
        """Names of the cameras, sorted."""
        return camera_names(self.paths)

    @property
    def seconds(self) -> float:
        """Time from the first to the last observation, [s]."""
        t_ns = self["observations/t_ns"][:]
        return float(t_ns[-1] - t_ns[0]) / 1e9

    @property
    def rates(self) -> dict[str, float]:
        """Mean rate of every stream and camera with at least two rows, [Hz], by the path of its timestamps."""
        rates = {}
        for path in self.paths:
            if path.endswith("/t_ns") and not path.startswith(EXTRA) and len(self[path]) > 1:
                t_ns = self[path][:]
                rates[path] = (len(t_ns) - 1) * 1e9 / max(1, int(t_ns[-1] - t_ns[0]))
        return rates

    def load(self, images: bool = True) -> Episode:
        """The episode in memory.

        Args:
            images: Whether to read the images now; otherwise each is read whenever it is asked for, by its row
                (``camera.arrays["color"][3]``) or all at once (``camera.color``).

        Raises:
            FieldError: If a field does not fit its declaration.
            FormatError: If the file has changed or cannot be read.
        """
        arrays: dict[str, Any] = {
            path: self[path] if not images and is_image(path) else np.array(self[path][()]) for path in self.paths
        }
        return Episode(self.meta, arrays, name=str(self.extent))

    def __getitem__(self, path: str) -> StoredArray:
        placements = header(self.extent).placements
        if path not in placements:
            raise FieldError(f"{self.extent}: recorded without {path}; it has {', '.join(placements)}")
        return StoredArray(path, self.extent, placements[path])

    def __contains__(self, path: object) -> bool:
        return path in header(self.extent).placements

    def __len__(self) -> int:
        return self["actions/action"].shape[0]

    def table(self) -> str:
        """Every array in one line: type, shape, unit, and mean rate if it has a clock."""
        rates, lines = self.rates, []
        for path in self.paths:
            array = self[path]
            unit = f" [{array.unit}]" if array.unit != "-" else ""
            clock = path.rpartition("/")[0] + "/t_ns"
            same = clock in rates and array.shape[:1] == self[clock].shape
            rate = f" at {rates[clock]:.1f} Hz" if same else ""
            lines.append(f"  {path} {array.dtype} {array.shape}{unit}{rate}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        head = f"Episode {self.meta.index} of {self.meta.task}: {len(self)} steps, {self.seconds:.2f} s, {self.extent}"
        return f"{head}\n{self.table()}"
