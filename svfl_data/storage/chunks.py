"""Places of the arrays of a sealed episode in its file, and reading of their rows without HDF5.

The HDF5 library spends most of the time of a small read on bookkeeping, allows one reader at a time per process, cannot
be carried into another process, and is not made for malicious files. But its file layout is open. Once the library has
told where the chunks are (in another process, `svfl_data.storage.examination`), reading a chunk takes one ``pread`` and
one ``zlib`` call, in any thread or process. A chunk can only have a form in which this package writes or accepts it:
whole rows, compressed by gzip or not, bytes shuffled or not. A chunk must give exactly the number of bytes that follows
from the shape of its array; otherwise it is refused. So only the shape decides how much memory is taken.
"""

import math
import os
import stat
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from svfl_data.errors import FormatError
from svfl_data.system.regular_file import kind_words, open_regular, refuse_link

BLOCK_BYTES = 2**22
SHUFFLE, GZIP, FLETCHER = 1, 2, 4
"""Bits of the filters in the last column of `Placement.chunks`, as in `svfl_data.storage.examiner.FILTERS`."""
FLETCHER32_BYTES = 4  # size of the checksum at the end of a chunk


@dataclass(frozen=True)
class Extent:
    """A range of bytes of a file that holds one sealed episode: a whole episode file, or a member of a shard.

    Attributes:
        file: Path of the file.
        offset: Position of the first byte of the episode in the file, [bytes].
        size: Size of the episode, seal included, [bytes].
        file_size: Size of the whole file when it was found, [bytes].
        mtime_ns: Time of the last change of the file's content when the file was found, [ns].
        member: Name of the episode inside its shard; empty if the episode has a file of its own.
        identity: Further facts by which the file was distinguished from others when it was found: device, inode, and
            time of the last change of its content or status [ns].
    """

    file: Path
    offset: int
    size: int
    file_size: int
    mtime_ns: int
    member: str = ""
    identity: tuple[int, int, int] = (0, 0, 0)

    @classmethod
    def of_file(cls, file: Path) -> "Extent":
        """Return the extent of a whole file, which must be an ordinary file: no link, pipe or device.

        Raises:
            FormatError: If the file does not exist or is not an ordinary file.
        """
        refuse_link(file)
        try:
            found = os.stat(file)
        except OSError as error:
            raise FormatError(f"{file}: {error.strerror}") from error
        if not stat.S_ISREG(found.st_mode):
            raise FormatError(f"{file}: {kind_words(found.st_mode)}, not an ordinary file; it was not read")
        identity = found.st_dev, found.st_ino, found.st_ctime_ns
        return cls(file, 0, found.st_size, found.st_size, found.st_mtime_ns, identity=identity)

    def part(self, member: str, offset: int, size: int) -> "Extent":
        """Return the extent of a member of a shard; this extent must be that of the whole shard.

        Args:
            member: Name of the episode inside the shard.
            offset: Position of the member's first byte in the shard, [bytes].
            size: Size of the member, [bytes].
        """
        return replace(self, member=member, offset=offset, size=size)

    def __str__(self) -> str:
        return f"{self.file}/{self.member}" if self.member else str(self.file)

    def open(self) -> int:
        """Open the file for `pread` and return its descriptor, which the caller must close.

        Raises:
            FormatError: If the file is gone, or has changed or been replaced since it was found.
        """
        try:
            descriptor = open_regular(self.file)
        except OSError as error:
            raise FormatError(f"{self}: {error.strerror}") from error
        found = os.fstat(descriptor)
        if (found.st_size, found.st_mtime_ns, found.st_ino) != (self.file_size, self.mtime_ns, self.identity[1]):
            os.close(descriptor)
            raise FormatError(f"{self}: changed while it was being read; open the dataset again")
        return descriptor

    def blocks(self) -> Iterator[bytes]:
        """Read the bytes of the episode from first to last, in blocks of `BLOCK_BYTES`."""
        descriptor = self.open()
        try:
            for start in range(0, self.size, BLOCK_BYTES):
                yield pread(self, descriptor, min(BLOCK_BYTES, self.size - start), start)
        finally:
            os.close(descriptor)


def pread(extent: Extent, descriptor: int, size: int, offset: int) -> bytes:
    """Read some bytes of an extent.

    Args:
        extent: Extent to read from.
        descriptor: Descriptor of its file, from `Extent.open`.
        size: Number of bytes to read.
        offset: Position of the first byte, counted from the beginning of the extent, [bytes].

    Raises:
        FormatError: If the bytes cannot be read, or the file ends before the last of them.
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
    """Type, shape and place of one array of an episode.

    Attributes:
        dtype: NumPy dtype of the elements.
        shape: Shape of the array.
        chunk_rows: Number of rows per chunk.
        chunks: Table with one row per chunk: offset in the extent and size [bytes], and bits of the filters that were
            applied; shape (K, 3), int64. Row r of the array lies in chunk r // `chunk_rows`.
        value: The array itself, if it has no rows or its rows cannot be read one by one; None otherwise.
    """

    dtype: np.dtype
    shape: tuple[int, ...]
    chunk_rows: int
    chunks: np.ndarray
    value: np.ndarray | None = None

    def rows(self, extent: Extent, descriptor: int, start: int, stop: int) -> np.ndarray:
        """Read the rows start .. stop-1, shape (stop - start, ...).

        Args:
            extent: Extent of the episode.
            descriptor: Descriptor of its file, from `Extent.open`.
            start: First row.
            stop: Row after the last one.

        Raises:
            FormatError: If a chunk is damaged or cannot be read.
        """
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
        """Read the rows of one chunk; the last chunk of an uncompressed array may have fewer rows than the others."""
        offset, size, applied = self.chunks[number].tolist()
        if applied & FLETCHER:
            size -= FLETCHER32_BYTES  # the checksum need not be checked: the seal was
        content = pread(extent, descriptor, size, offset)
        try:
            if applied & GZIP:
                content = _inflated(content, self.chunk_rows * self.row_bytes)
            flat = _unshuffled(content, self.dtype) if applied & SHUFFLE else np.frombuffer(content, self.dtype)
            if self.dtype.kind == "b":
                flat = flat.view(np.uint8) != 0  # NumPy expects only the bytes 0 and 1 in booleans
            return flat.reshape((-1, *self.shape[1:]))
        except (zlib.error, ValueError) as error:
            raise FormatError(f"{extent}: damaged at byte {offset} ({error})") from error

    @property
    def row_bytes(self) -> int:
        """Size of one row in memory, [bytes]."""
        return self.dtype.itemsize * math.prod(self.shape[1:])


def _inflated(content: bytes, size: int) -> bytes:
    """Decompress a chunk that must have exactly `size` bytes; never more than that is held in memory."""
    inflater = zlib.decompressobj()
    inflated = inflater.decompress(content, size)
    if len(inflated) == size and not inflater.eof:
        inflated += inflater.decompress(inflater.unconsumed_tail, 1)  # the checksum behind the last byte
    if len(inflated) != size or not inflater.eof:
        raise ValueError(f"a chunk does not hold {size} bytes")
    return inflated


def _unshuffled(content: bytes, dtype: np.dtype) -> np.ndarray:
    """Undo HDF5's shuffle filter, which stores the first bytes of all elements, then all second bytes, and so on."""
    planes = np.frombuffer(content, np.uint8).reshape(dtype.itemsize, -1)
    elements = np.empty(planes.shape[1], dtype)
    interleaved = elements.view(np.uint8).reshape(-1, dtype.itemsize)
    for byte, plane in enumerate(planes):
        interleaved[:, byte] = plane
    return elements
