"""Where the arrays of a sealed episode lie, byte by byte, and how to read rows of them without HDF5.

HDF5 spends most of the time of a small read on bookkeeping, allows one reader at a time per process and cannot be
carried into another one. Its file layout is open: once its library has said where the chunks are, a chunk is one
``pread`` and one ``zlib`` call, in any thread or process. What a chunk can be here follows from how we write them:
whole rows, compressed by gzip or not, bytes shuffled or not. Anything else, such as an array that another tool added
and sealed, is read when the episode is opened and kept.
"""

import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from svfl_data.errors import FormatError

BLOCK_BYTES = 2**22
SHUFFLE, GZIP, FLETCHER = 1, 2, 4  # bits of the last column of `Placement.chunks`
FILTERS = {h5py.h5z.FILTER_SHUFFLE: SHUFFLE, h5py.h5z.FILTER_DEFLATE: GZIP, h5py.h5z.FILTER_FLETCHER32: FLETCHER}
FLETCHER32_BYTES = 4  # stand at the end of a chunk


@dataclass(frozen=True)
class Extent:
    """A piece of a file that holds one sealed episode: a whole episode file, or a member of a shard.

    Attributes:
        file: Where.
        offset: First byte.
        size: Number of bytes, seal included.
        file_size: Size of the whole file when it was found.
        mtime_ns: Time of its last change when it was found, [ns].
        member: Name of the episode inside a shard; empty for a file of its own.
    """

    file: Path
    offset: int
    size: int
    file_size: int
    mtime_ns: int
    member: str = ""

    @classmethod
    def of_file(cls, file: Path) -> "Extent":
        """The whole of a file.

        Raises:
            FormatError: If there is no such file.
        """
        try:
            found = os.stat(file)
        except OSError as error:
            raise FormatError(f"{file}: {error.strerror}") from error
        return cls(file, 0, found.st_size, found.st_size, found.st_mtime_ns)

    def __str__(self) -> str:
        return f"{self.file}/{self.member}" if self.member else str(self.file)

    def open(self) -> int:
        """A descriptor of the file, for `pread`; the caller closes it.

        Raises:
            FormatError: If the file is gone or is no longer the one that was found.
        """
        try:
            descriptor = os.open(self.file, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise FormatError(f"{self}: {error.strerror}") from error
        found = os.fstat(descriptor)
        if (found.st_size, found.st_mtime_ns) != (self.file_size, self.mtime_ns):
            os.close(descriptor)
            raise FormatError(f"{self}: changed while it was being read; open the dataset again")
        return descriptor

    def blocks(self) -> Iterator[bytes]:
        """Its bytes from first to last, a few MB at a time."""
        descriptor = self.open()
        try:
            for start in range(0, self.size, BLOCK_BYTES):
                yield pread(self, descriptor, min(BLOCK_BYTES, self.size - start), start)
        finally:
            os.close(descriptor)


def pread(extent: Extent, descriptor: int, size: int, offset: int) -> bytes:
    """Bytes of an extent.

    Args:
        extent: Of what.
        descriptor: From `Extent.open`.
        size: How many bytes.
        offset: Of the first, counted from the beginning of the extent.

    Raises:
        FormatError: If they cannot be read.
    """
    try:
        content = os.pread(descriptor, size, extent.offset + offset)
    except OSError as error:
        raise FormatError(f"{extent}: {error.strerror}") from error
    if len(content) != size:
        raise FormatError(f"{extent}: ends early ({len(content)} of {size} bytes at {offset})")
    return content


@dataclass(frozen=True, eq=False)
class Placement:
    """Type, shape and whereabouts of one array.

    Attributes:
        dtype: Of its elements.
        shape: Its sizes.
        chunk_rows: Rows per chunk.
        chunks: Offset and size in bytes, and which filters were applied, of each chunk: shape (K, 3), int64, a chunk's
            position being its row // `chunk_rows`.
        value: The array itself, if its chunks cannot be read directly.
    """

    dtype: np.dtype
    shape: tuple[int, ...]
    chunk_rows: int
    chunks: np.ndarray
    value: np.ndarray | None = None

    def rows(self, extent: Extent, descriptor: int, start: int, stop: int) -> np.ndarray:
        """Rows start .. stop-1, shape (stop - start, ...)."""
        if self.value is not None:
            return self.value[start:stop]
        if stop - start == 1 == self.chunk_rows:
            return self._chunk(extent, descriptor, start)
        out = np.empty((max(0, stop - start), *self.shape[1:]), self.dtype)
        for number in range(start // self.chunk_rows, -(-stop // self.chunk_rows) if stop > start else 0):
            first = number * self.chunk_rows
            low, high = max(start, first), min(stop, first + self.chunk_rows)
            out[low - start : high - start] = self._chunk(extent, descriptor, number)[low - first : high - first]
        return out

    def _chunk(self, extent: Extent, descriptor: int, number: int) -> np.ndarray:
        offset, size, applied = self.chunks[number].tolist()
        if applied & FLETCHER:
            size -= FLETCHER32_BYTES  # nothing is gained by checking it: the seal was
        content = pread(extent, descriptor, size, offset)
        shape = (self.chunk_rows, *self.shape[1:])
        try:
            if applied & GZIP:
                content = zlib.decompress(content)
            if applied & SHUFFLE:
                return _unshuffled(content, self.dtype).reshape(shape)
            return np.frombuffer(content, self.dtype).reshape(shape)
        except (zlib.error, ValueError) as error:
            raise FormatError(f"{extent}: damaged at byte {offset} ({error})") from error


def _unshuffled(content: bytes, dtype: np.dtype) -> np.ndarray:
    """Undo HDF5's shuffle filter: all first bytes, then all second bytes, and so on."""
    planes = np.frombuffer(content, np.uint8).reshape(dtype.itemsize, -1)
    elements = np.empty(planes.shape[1], dtype)
    interleaved = elements.view(np.uint8).reshape(-1, dtype.itemsize)
    for byte, plane in enumerate(planes):
        interleaved[:, byte] = plane
    return elements


def placement(dataset: h5py.h5d.DatasetID) -> Placement:
    """Find out where an array lies.

    Args:
        dataset: The array in an HDF5 file that starts at byte 0 of its extent.
    """
    shape, dtype, plan = tuple(dataset.shape), dataset.dtype, dataset.get_create_plist()
    filters = [plan.get_filter(position)[0] for position in range(plan.get_nfilters())]
    chunk = plan.get_chunk() if plan.get_layout() == h5py.h5d.CHUNKED else ()
    if chunk and chunk[1:] == shape[1:] and set(filters) <= set(FILTERS) and not dtype.hasobject:
        chunks = np.full((-(-shape[0] // chunk[0]), 3), -1, np.int64)

        def note(info: h5py.h5d.StoreInfo) -> None:
            applied = sum(FILTERS[code] for bit, code in enumerate(filters) if not info.filter_mask >> bit & 1)
            chunks[info.chunk_offset[0] // chunk[0]] = info.byte_offset, info.size, applied

        dataset.chunk_iter(note)
        if (chunks[:, 0] >= 0).all():  # a chunk that was never written holds the fill value
            return Placement(dtype, shape, chunk[0], chunks)
    return Placement(dtype, shape, 1, np.empty((0, 3), np.int64), np.asarray(h5py.Dataset(dataset)[()]))
