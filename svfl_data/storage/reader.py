"""Lazy reading of one episode: shapes are known at once, numbers are read only when they are asked for.

An episode is checked when it is first opened (`svfl_data.storage.header`). From then on its bytes are read by `pread`
at known places (`svfl_data.storage.chunks`), and the read is refused if the file has changed meanwhile. A reader holds
no open file: it can be copied, pickled, and carried through a fork. Reading a whole episode compares its bytes with its
seal, once in each process. Reading single rows relies on the file being unchanged since its seal was last compared.
"""

import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svfl_data.errors import FieldError, FormatError
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.fields import EXTRA, camera_names
from svfl_data.storage.chunks import Extent, pread
from svfl_data.storage.damage import damaged_arrays
from svfl_data.storage.header import Header, header, stored_arrays, unsealed_header
from svfl_data.storage.metadata import parse_meta
from svfl_data.storage.seal import SEAL_MARK, SEAL_SIZE
from svfl_data.storage.stored_array import StoredArray as StoredArray  # imported for users of this module
from svfl_data.system.printable import printable


@dataclass(frozen=True)
class EpisodeReader:
    """An episode on disk, whose arrays are read only on request, as in ``reader["streams/wrench/wrench"][-64:]``.

    Attributes:
        extent: Place of the episode: its file, or the part of a shard that holds it.

    Example:
        >>> reader = dataset.episode(0)
        >>> reader["streams/wrench/wrench"][-64:].shape
        (64, 6)
    """

    extent: Extent

    @classmethod
    def of_file(cls, file: Path | str) -> "EpisodeReader":
        """Return the reader of an episode file that the user names; the path may be a symbolic link.

        Raises:
            FormatError: If there is no such file, or it is a folder, pipe or device.
        """
        return cls(_named(Path(file)))

    @property
    def seal(self) -> str:
        """Seal of the episode: the SHA-256 of its content, in hexadecimal. Equal episodes have equal seals."""
        return header(self.extent).seal

    @property
    def written_seal(self) -> str:
        """Seal as it stands in the file, in hexadecimal, read without checking it against the content.

        Raises:
            FormatError: If the episode has no seal, or its file has changed or cannot be read.
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
        """Version of the file format in which the episode was written, such as ``2.0``."""
        return str(header(self.extent).attributes["format_version"])

    @functools.cached_property
    def meta(self) -> Meta:
        """Metadata of the episode."""
        return parse_meta(header(self.extent).attributes, self.extent)

    @property
    def declarations(self) -> Declarations:
        """Declarations of the episode's arrays."""
        return header(self.extent).declarations

    @property
    def paths(self) -> list[str]:
        """Dataset paths of the episode's arrays."""
        return list(header(self.extent).placements)

    @property
    def cameras(self) -> list[str]:
        """Names of the episode's cameras, sorted."""
        return camera_names(self.paths)

    def image_size(self, camera: str) -> tuple[int, int]:
        """Return height and width of a camera's images, [px].

        Args:
            camera: Name of the camera.
        """
        height, width = self[self.declarations.image_paths(camera, self.paths)[0]].shape[1:3]
        return height, width

    @property
    def seconds(self) -> float:
        """Time from the first to the last observation, [s]."""
        t_ns = self["observations/t_ns"][:]
        return float(t_ns[-1] - t_ns[0]) / 1e9

    @property
    def rates(self) -> dict[str, float]:
        """Mean rate of every stream and camera with at least two rows, [Hz], by the path of its time stamps."""
        rates = {}
        for path in self.paths:
            if path.endswith("/t_ns") and not path.startswith(EXTRA) and len(self[path]) > 1:
                t_ns = self[path][:]
                rates[path] = (len(t_ns) - 1) * 1e9 / max(1, int(t_ns[-1] - t_ns[0]))
        return rates

    def load(self, images: bool = True) -> Episode:
        """Read the whole episode into memory, and compare its bytes with its seal.

        Args:
            images: Whether to read images, arrays of large rows and those below ``extra/`` into memory, too. If False,
                they are `StoredArray` objects, which read rows when indexed and cannot be read any more once the file
                has changed. These suffice to check or copy an episode in little memory, however large its images are.

        Raises:
            FieldError: If a field does not fit its declaration.
            FormatError: If the file has changed, is damaged, or cannot be read.
        """
        return load_arrays(self.extent, header(self.extent, hashed=True), images)

    def __getitem__(self, path: str) -> StoredArray:
        found = header(self.extent)
        if path not in found.placements:
            raise FieldError(f"{self.extent}: recorded without {path}; it has {', '.join(found.placements)}")
        return StoredArray(path, self.extent, found.placements[path], found.declarations.at(path))

    def __contains__(self, path: object) -> bool:
        return path in header(self.extent).placements

    def __len__(self) -> int:
        return self["observations/t_ns"].shape[0] - 1

    def table(self) -> str:
        """Describe every array in one line: type, shape, unit, and mean rate if the array has time stamps."""
        rates, lines = self.rates, []
        for path in self.paths:
            array = self[path]
            unit = f" [{array.unit}]" if array.unit != "-" else ""
            clock = path.rpartition("/")[0] + "/t_ns"
            same = clock in rates and array.shape[:1] == self[clock].shape
            rate = f" at {rates[clock]:.1f} Hz" if same else ""
            lines.append(printable(f"  {path} {array.dtype} {array.shape}{unit}{rate}"))
        return "\n".join(lines)

    def __repr__(self) -> str:
        head = f"Episode {self.meta.index} of {self.meta.task}: {len(self)} steps, {self.seconds:.2f} s, {self.extent}"
        return f"{printable(head)}\n{self.table()}"


def read_episode(path: Path | str, images: bool = True) -> Episode:
    """Read a whole episode.

    Args:
        path: Path of an episode file.
        images: Whether to read images into memory, too; see `EpisodeReader.load`.

    Returns:
        The episode, with every array checked against its declaration.

    Raises:
        FormatError: If the file is missing, truncated, damaged, not an episode, or of an unknown version.
        FieldError: If a field is missing or does not fit its declaration.

    Example:
        >>> read_episode("data/week/episode_000000.hdf5").meta.task
        'centering'
    """
    return EpisodeReader.of_file(path).load(images)


def read_unsealed(path: Path) -> Episode:
    """Read an episode file that lost its seal to other software.

    Without a seal, damage may go unnoticed: the numbers that HDF5 reads may differ from those that were written.

    Raises:
        FormatError: If the file is not a readable episode.
        FieldError: If a field is missing or does not fit its declaration.
    """
    extent = Extent.of_file(path)
    if damaged := damaged_arrays(path):
        raise FormatError(f"{path}: damaged, {', '.join(damaged)} cannot be read")
    return load_arrays(extent, unsealed_header(extent), images=True)


def _named(file: Path) -> Extent:
    """Return the extent of a whole file that the user names; the path may be a symbolic link."""
    if file.is_dir():
        raise FormatError(f"{file}: is a folder, not an episode file")
    if not file.exists():
        raise FormatError(f"{file}: no such file")
    return Extent.of_file(file.resolve() if file.is_symlink() else file)


def load_arrays(extent: Extent, found: Header, images: bool) -> Episode:
    """Read the arrays of an episode whose header is known.

    Args:
        extent: Place of the episode.
        found: Header of the episode.
        images: Whether to read images into memory, too; see `EpisodeReader.load`.

    Raises:
        FieldError: If a field does not fit its declaration.
        FormatError: If the file has changed, is damaged, or cannot be read.
    """
    arrays: dict[str, Any] = {  # a `StoredArray` gives rows as an array does
        path: array if not images and (array.field is None or array.field.large) else array[()]
        for path, array in stored_arrays(extent, found).items()
    }
    return Episode(parse_meta(found.attributes, extent), arrays, str(extent), found.declarations)
