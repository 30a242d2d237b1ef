"""The append-only file in which an episode grows while it is recorded; whatever ends the writer, it stays readable.

A journal is a sequence of records, each a header (`HEADER`: magic, bytes of the label, bytes of the content, CRC-32 of
both), a label (JSON) and the content. ``{"meta": ...}`` opens the journal; ``{"path", "dtype", "shape", "start"}``
gives rows of a stream from a certain row on, and a whole array with ``"constant"`` in place of ``"start"``;
``{"end": ...}`` closes it with the final metadata.
Nothing is ever overwritten, so what was intact once stays so, and reading stops at the first record that is not.
"""

import json
import os
import struct
import zlib
from array import array
from bisect import bisect_right
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.episode import canonical_json
from svfl_data.errors import StorageError
from svfl_data.sink import write_all

HEADER = struct.Struct("<4sIQI")
MAGIC = b"SVJ1"
SUFFIX = ".journal"


class JournalWriter:
    """Appends records to a new journal.

    Args:
        descriptor: The file: empty and open for reading and writing; closed with `close`.
        path: Its name, for messages.
    """

    def __init__(self, descriptor: int, path: Path) -> None:
        self.descriptor = descriptor
        self.path = path
        self._end = 0
        self._syncer = ThreadPoolExecutor(1)
        self._sync: Future[None] | None = None

    def append(self, label: dict[str, Any], content: bytes | bytearray | memoryview = b"") -> None:
        """Append a record; when this returns, a killed process loses it no more.

        Raises:
            StorageError: If the disk refuses; the journal is as it was before and may be appended to again.
        """
        words = canonical_json(label).encode()
        head = HEADER.pack(MAGIC, len(words), len(content), zlib.crc32(content, zlib.crc32(words)))
        size = len(head) + len(words) + len(content)
        try:
            write_all(self.descriptor, memoryview(head + words), self._end)
            write_all(self.descriptor, memoryview(content), self._end + len(head) + len(words))
        except OSError as error:
            os.ftruncate(self.descriptor, self._end)
            free = os.fstatvfs(self.descriptor)
            raise StorageError(
                f"cannot record to {self.path}: {error.strerror} ({size} more bytes needed, "
                f"{free.f_bavail * free.f_frsize} free); everything recorded before is intact"
            ) from error
        self._end += size

    def sync(self) -> None:
        """Have the disk, not only the system, take what was appended so far; does not wait for it.

        Raises:
            StorageError: If the disk refused the previous time.
        """
        if self._sync is not None and not self._sync.done():
            return
        try:
            if self._sync is not None:
                self._sync.result()
        except OSError as error:
            raise StorageError(f"cannot record to {self.path}: {error.strerror}") from error
        self._sync = self._syncer.submit(os.fdatasync, self.descriptor)

    def close(self) -> None:
        """Close the file, which also gives up its lock; the journal stays."""
        self._syncer.shutdown()
        os.close(self.descriptor)


@dataclass(frozen=True)
class JournalRows:
    """A stream in a journal, as an array whose slices of rows are read when asked for.

    Attributes:
        descriptor: The journal, open for reading.
        dtype: Type of its numbers.
        row_shape: Shape of a row.
        starts: First row of each record.
        offsets: Where the content of each record begins in the file.
        rows: Number of rows.
    """

    descriptor: int
    dtype: np.dtype
    row_shape: tuple[int, ...]
    starts: "array[int]"
    offsets: "array[int]"
    rows: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the whole array."""
        return (self.rows, *self.row_shape)

    @property
    def row_bytes(self) -> int:
        """Bytes of a row."""
        return int(np.prod(self.row_shape, dtype=np.int64)) * self.dtype.itemsize

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, _ = rows.indices(self.rows)
        block = np.empty((max(0, stop - start), *self.row_shape), self.dtype)
        view = block.reshape(-1).view(np.uint8).data
        record = bisect_right(self.starts, start) - 1
        while start < stop:
            last = self.starts[record + 1] if record + 1 < len(self.starts) else self.rows
            size = (min(stop, last) - start) * self.row_bytes
            offset = self.offsets[record] + (start - self.starts[record]) * self.row_bytes
            if os.preadv(self.descriptor, [view[:size]], offset) != size:
                raise OSError(f"journal ends before offset {offset + size}")
            view, start, record = view[size:], min(stop, last), record + 1
        return block

    def first(self, rows: int) -> "JournalRows":
        """The first rows only."""
        return JournalRows(self.descriptor, self.dtype, self.row_shape, self.starts, self.offsets, rows)


@dataclass
class Journal:
    """What is intact in a journal.

    Attributes:
        meta: Metadata that it was opened with; None if not even that is intact.
        end: Final metadata; None if the writer never got that far.
        constants: Arrays that do not grow, by dataset path.
        streams: Arrays that grow, by dataset path.
        intact: Bytes up to the end of the last intact record.
        size: Bytes of the file.
    """

    meta: dict[str, Any] | None = None
    end: dict[str, Any] | None = None
    constants: dict[str, np.ndarray] = field(default_factory=dict)
    streams: dict[str, JournalRows] = field(default_factory=dict)
    intact: int = 0
    size: int = 0


def read_journal(descriptor: int) -> Journal:
    """Read a journal up to its last intact record; rows stay on disk, so memory does not grow with the episode.

    Args:
        descriptor: The journal, open for reading; must stay open while the streams are used.
    """
    journal = Journal(size=os.fstat(descriptor).st_size)
    for label, content, offset in _records(descriptor, journal.size):
        if "meta" in label:
            journal.meta = label["meta"]
        elif "end" in label:
            journal.end = label["end"]
        elif label.get("constant"):
            flat = np.frombuffer(bytearray(content), label["dtype"])
            journal.constants[label["path"]] = flat.reshape(label["shape"])
        else:
            _add_rows(journal.streams, label, descriptor, offset)
        journal.intact = offset + len(content)
    return journal


def _add_rows(streams: dict[str, JournalRows], label: dict[str, Any], descriptor: int, offset: int) -> None:
    """Add the rows of a record that are new: one that was interrupted may have been written again, and longer."""
    rows, *row_shape = label["shape"]
    empty = JournalRows(descriptor, np.dtype(label["dtype"]), tuple(row_shape), array("q"), array("q"), 0)
    stream = streams.get(label["path"], empty)
    known = stream.rows - label["start"]
    if rows > known:
        stream.starts.append(stream.rows)
        stream.offsets.append(offset + known * stream.row_bytes)
        stream = stream.first(label["start"] + rows)
    streams[label["path"]] = stream


def _records(descriptor: int, size: int) -> Iterator[tuple[dict[str, Any], bytes, int]]:
    """The intact records: label, content and where the content begins."""
    offset = 0
    while True:
        head = os.pread(descriptor, HEADER.size, offset)
        if len(head) < HEADER.size:
            return
        magic, label_size, content_size, checksum = HEADER.unpack(head)
        offset += HEADER.size
        if magic != MAGIC or offset + label_size + content_size > size:
            return
        label = os.pread(descriptor, label_size, offset)
        content = os.pread(descriptor, content_size, offset + label_size)
        if zlib.crc32(content, zlib.crc32(label)) != checksum:
            return
        yield json.loads(label), content, offset + label_size
        offset += label_size + content_size
