"""Where the arrays of a sealed episode lie, byte by byte, and how to read rows of them without HDF5.

HDF5 spends most of the time of a small read on bookkeeping, allows one reader at a time per process, cannot be
carried into another one, and is not made for files that somebody made to harm it. Its file layout is open: once its
library has said where the chunks are (in another process, `svfl_data.storage.examination`), a chunk is one ``pread``
and one ``zlib`` call, in any thread or process. What a chunk can be here follows from how we write them: whole rows,
compressed by gzip or not, bytes shuffled or not. A chunk gives exactly the bytes that its array's shape says, or is
refused; nothing else decides how much memory is taken.
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
"""Bits of the last column of `Placement.chunks`, as in `svfl_data.storage.examiner.FILTERS`."""
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
        identity: What else told the file from others when it was found: device, inode, time of the last change of
            content or description [ns].
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
        """The whole of a file, which must be an ordinary one: no link, pipe or device.

        Raises:
            FormatError: If there is no such file.
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
        """A member of the shard that this is the whole of."""
        return replace(self, member=member, offset=offset, size=size)

    def __str__(self) -> str:
        return f"{self.file}/{self.member}" if self.member else str(self.file)

    def open(self) -> int:
        """A descriptor of the file, for `pread`; the caller closes it.

        Raises:
            FormatError: If the file is gone or is no longer the one that was found.
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
        value: The array itself, if it has no rows, or rows that cannot be read one by one.
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
        """The rows of a chunk; the last one of an array without compression may have fewer than the others."""
        offset, size, applied = self.chunks[number].tolist()
        if applied & FLETCHER:
            size -= FLETCHER32_BYTES  # nothing is gained by checking it: the seal was
        content = pread(extent, descriptor, size, offset)
        try:
            if applied & GZIP:
                content = _inflated(content, self.chunk_rows * self.row_bytes)
            flat = _unshuffled(content, self.dtype) if applied & SHUFFLE else np.frombuffer(content, self.dtype)
            if self.dtype.kind == "b":
                flat = flat.view(np.uint8) != 0  # NumPy takes other bytes than 0 and 1 for granted
            return flat.reshape((-1, *self.shape[1:]))
        except (zlib.error, ValueError) as error:
            raise FormatError(f"{extent}: damaged at byte {offset} ({error})") from error

    @property
    def row_bytes(self) -> int:
        """Bytes of a row in memory."""
        return self.dtype.itemsize * math.prod(self.shape[1:])


def _inflated(content: bytes, size: int) -> bytes:
    """What was compressed, if it is as large as it must be; no more than that is ever in memory."""
    inflater = zlib.decompressobj()
    inflated = inflater.decompress(content, size)
    if len(inflated) == size and not inflater.eof:
        inflated += inflater.decompress(inflater.unconsumed_tail, 1)  # the checksum behind the last byte
    if len(inflated) != size or not inflater.eof:
        raise ValueError(f"a chunk does not hold {size} bytes")
    return inflated


def _unshuffled(content: bytes, dtype: np.dtype) -> np.ndarray:
    """Undo HDF5's shuffle filter: all first bytes, then all second bytes, and so on."""
    planes = np.frombuffer(content, np.uint8).reshape(dtype.itemsize, -1)
    elements = np.empty(planes.shape[1], dtype)
    interleaved = elements.view(np.uint8).reshape(-1, dtype.itemsize)
    for byte, plane in enumerate(planes):
        interleaved[:, byte] = plane
    return elements
