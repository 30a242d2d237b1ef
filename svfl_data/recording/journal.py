"""The append-only file in which an episode grows while it is recorded; whatever ends the writer, it stays readable.

A journal is a sequence of records, each a header (`HEADER`: magic, bytes of the label, bytes of the content, CRC-32 of
both), a label (JSON, `Label`) and the content. ``{"meta": ...}`` opens the journal; ``{"path", "dtype", "shape",
"start"}`` gives rows of a stream from a certain row on, and a whole array with ``"constant"`` in place of ``"start"``;
``{"gap": ...}`` and ``{"fault": ...}`` say what is missing and what went wrong; ``{"end": ...}`` closes it with the
final metadata. Nothing is ever overwritten, so what was intact once stays so. After a damaged record reading goes on
with the next intact one; since rows are numbered, what is missing between them is known.

A journal may come from anywhere, so nothing in it is believed before it is checked: labels against their types, sizes
against the file.
"""

import os
import struct
import zlib
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from svfl_data.errors import StorageError
from svfl_data.recording.growth import grows
from svfl_data.schema.episode import Meta, canonical_json
from svfl_data.schema.fields import EXTRA, PLAIN_KINDS, field_at, harmless
from svfl_data.storage.sink import write_all
from svfl_data.system.own_process import OwnProcess

HEADER = struct.Struct("<4sIQI")
MAGIC = b"SVJ1"
SUFFIX = ".journal"
BLOCK = 2**22
"""Bytes that are read at once, so that memory does not grow with a record."""
LABEL_BYTES = 2**22
"""Size of a label at most; metadata hold the configuration."""
ARRAYS, WORDS = 1000, 10_000
"""Arrays of an episode, and declared gaps or faults, at most."""
ROW_BYTES = 2**32
"""Size of a row at most."""
DIMENSIONS = 16
"""Of an array at most."""
SEARCHED, SEARCH_BLOCK = 8, 2**16
"""How often the size of the file is read at most while looking for intact records after damage; bytes read at once."""


class JournalWriter(OwnProcess):
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
            UsageError: In another process than the writer's.
        """
        self.check_process()
        words = canonical_json(label).encode()
        head = HEADER.pack(MAGIC, len(words), len(content), zlib.crc32(content, zlib.crc32(words)))
        size = len(head) + len(words) + len(content)
        try:
            write_all(self.descriptor, memoryview(head + words), self._end)
            write_all(self.descriptor, memoryview(content), self._end + len(head) + len(words))
        except OSError as error:
            raise self._refusal(error, size) from error
        self._end += size

    def sync(self) -> None:
        """Have the disk, not only the system, take what was appended so far; does not wait for it.

        Raises:
            StorageError: If the disk refused the previous time.
            UsageError: In another process than the writer's.
        """
        self.check_process()
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
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            with suppress(OSError):  # of a disk that is gone; what it had not taken was not promised
                os.close(descriptor)

    def forked(self) -> None:
        """A fork of the process holds neither the file nor its lock, so that repair can tell when the writer dies."""
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _refusal(self, error: OSError, size: int) -> StorageError:
        try:
            os.ftruncate(self.descriptor, self._end)
            free = os.fstatvfs(self.descriptor)
            room = f"{size} more bytes needed, {free.f_bavail * free.f_frsize} free"
        except OSError:  # a disk that is gone refuses this as well
            room = f"{size} more bytes needed"
        return StorageError(
            f"cannot record to {self.path}: {error.strerror} ({room}); everything recorded before is intact"
        )


class Label(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What stands before the content of a record; which of these it has says what it is.

    Attributes:
        meta: Metadata at the beginning.
        end: Final metadata.
        gap: Arguments of a `svfl_data.schema.clocks.Gap`.
        fault: What went wrong, in words.
        path: Dataset path of an array.
        dtype: Type of its numbers, as NumPy writes it.
        shape: Its sizes, or those of the rows in this record.
        start: First row; absent for constants.
        constant: Whether the array does not grow.
    """

    meta: Meta | None = None
    end: Meta | None = None
    gap: dict[str, Any] | None = None
    fault: str | None = None
    path: str = ""
    dtype: str = ""
    shape: list[int] = []
    start: int = 0
    constant: bool = False


@dataclass(frozen=True)
class JournalRows:
    """Rows of a stream in a journal, as an array whose slices are read when asked for.

    Attributes:
        descriptor: The journal, open for reading.
        dtype: Type of its numbers.
        row_shape: Shape of a row.
        starts: First row of each piece.
        offsets: Where the content of each piece begins in the file.
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
        return prod(self.row_shape) * self.dtype.itemsize

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, _ = rows.indices(self.rows)
        block = np.empty((max(0, stop - start), *self.row_shape), self.dtype)
        view = block.reshape(-1).view(np.uint8).data if block.size else memoryview(b"")
        piece = bisect_right(self.starts, start) - 1
        while start < stop and view:
            last = self.starts[piece + 1] if piece + 1 < len(self.starts) else self.rows
            size = (min(stop, last) - start) * self.row_bytes
            offset = self.offsets[piece] + (start - self.starts[piece]) * self.row_bytes
            if os.preadv(self.descriptor, [view[:size]], offset) != size:
                raise OSError(f"journal ends before offset {offset + size}")
            view, start, piece = view[size:], min(stop, last), piece + 1
        return block


Spans = list[tuple[int, int]]
"""Ranges of rows, from one to before another, disjoint and ascending."""


@dataclass
class Stream:
    """What is intact of a stream; its rows are numbered as they were appended.

    Attributes:
        descriptor: The journal, open for reading.
        dtype: Type of its numbers.
        row_shape: Shape of a row.
    """

    descriptor: int
    dtype: np.dtype
    row_shape: tuple[int, ...]
    _firsts: "array[int]" = field(default_factory=lambda: array("q"))
    _stops: "array[int]" = field(default_factory=lambda: array("q"))
    _offsets: "array[int]" = field(default_factory=lambda: array("q"))

    def add(self, start: int, rows: int, offset: int) -> None:
        """Add the rows of a record that are new: an interrupted one may have been written again, and longer."""
        known = self._stops[-1] if self._stops else 0
        first = max(start, known)
        if start + rows > first:
            self._firsts.append(first)
            self._stops.append(start + rows)
            self._offsets.append(offset + (first - start) * prod(self.row_shape) * self.dtype.itemsize)

    @property
    def spans(self) -> Spans:
        """Which rows are intact."""
        spans: Spans = []
        for first, stop in zip(self._firsts, self._stops, strict=True):
            if spans and spans[-1][1] == first:
                spans[-1] = spans[-1][0], stop
            else:
                spans.append((first, stop))
        return spans

    def rows(self, spans: Iterable[tuple[int, int]] | None = None) -> JournalRows:
        """Some intact rows, one after the other.

        Args:
            spans: Which, disjoint and ascending, within `spans`; by default all.
        """
        starts, offsets, count, size = array("q"), array("q"), 0, prod(self.row_shape) * self.dtype.itemsize
        for low, high in self.spans if spans is None else spans:
            piece = bisect_right(self._firsts, low) - 1
            while low < high:
                stop = min(high, self._stops[piece])
                starts.append(count)
                offsets.append(self._offsets[piece] + (low - self._firsts[piece]) * size)
                count, low, piece = count + stop - low, stop, piece + 1
        return JournalRows(self.descriptor, self.dtype, self.row_shape, starts, offsets, count)


@dataclass
class Journal:
    """What is intact in a journal.

    Attributes:
        meta: Metadata that it was opened with; None if they are not intact.
        end: Final metadata; None if the writer never got that far.
        constants: Arrays that do not grow, by dataset path.
        streams: Arrays that grow, by dataset path.
        gaps: What was declared, as arguments of `svfl_data.schema.clocks.Gap`; later ones with the same start replace
            earlier.
        faults: What went wrong while recording, in words.
        damaged: Where something is not intact: first byte and number of bytes.
        size: Bytes of the file.
    """

    size: int
    meta: Meta | None = None
    end: Meta | None = None
    constants: dict[str, np.ndarray] = field(default_factory=dict)
    streams: dict[str, Stream] = field(default_factory=dict)
    gaps: list[dict[str, Any]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    damaged: list[tuple[int, int]] = field(default_factory=list)

    @property
    def incomplete(self) -> bool:
        """Whether something is missing before what is intact; a killed writer leaves damage at the end only."""
        every = [stream.spans for stream in self.streams.values()]
        holes = any(len(spans) > 1 or spans[0][0] > 0 for spans in every if spans)
        return holes or any(start + size < self.size for start, size in self.damaged)


def read_journal(descriptor: int) -> Journal:
    """Read what is intact of a journal; rows stay on disk, so memory does not grow with the episode.

    Args:
        descriptor: The journal, open for reading; must stay open while the streams are used.
    """
    journal = Journal(size=os.fstat(descriptor).st_size)
    known = 0
    for label, offset, size, begin in _records(descriptor, journal.size):
        if begin > known:
            journal.damaged.append((known, begin - known))
        known = offset + size
        if label.path:
            _add_array(journal, label, descriptor, offset, size)
        elif label.end is not None:
            journal.end = label.end
        elif label.meta is not None:
            journal.meta = journal.meta or label.meta
        elif label.gap is not None and len(journal.gaps) < WORDS:
            journal.gaps.append(label.gap)
        elif label.fault is not None and len(journal.faults) < WORDS:
            journal.faults.append(label.fault)
    if known < journal.size:
        journal.damaged.append((known, journal.size - known))
    return journal


def _add_array(journal: Journal, label: Label, descriptor: int, offset: int, size: int) -> None:
    dtype = np.dtype(label.dtype)
    if len(journal.constants) + len(journal.streams) > ARRAYS:
        journal.damaged.append((offset, size))
        return
    if label.constant:
        flat = np.frombuffer(bytearray(os.pread(descriptor, size, offset)), dtype)
        journal.constants[label.path] = flat.reshape(label.shape)
        return
    rows, *row_shape = label.shape
    stream = journal.streams.setdefault(label.path, Stream(descriptor, dtype, tuple(row_shape)))
    if (stream.dtype, stream.row_shape) == (dtype, tuple(row_shape)):
        stream.add(label.start, rows, offset)
        journal.end = None  # the writer could not seal, and went on
    else:
        journal.damaged.append((offset, size))


def _records(descriptor: int, size: int) -> Iterator[tuple[Label, int, int, int]]:
    """The intact records: label, where the content begins, its bytes, and where the record begins."""
    offset, left = 0, SEARCHED * size + 1000 * SEARCH_BLOCK
    while offset < size:
        found = _record(descriptor, offset, size)
        if found:
            label, begin, content = found
            yield label, begin, content, offset
            offset = begin + content
            continue
        at = _next_magic(descriptor, offset + 1, size)
        left -= at - offset + SEARCH_BLOCK + _claimed(descriptor, at, size)
        if left < 0:
            return  # made to take for ever
        offset = at


def _record(descriptor: int, offset: int, size: int) -> tuple[Label, int, int] | None:
    """The record at an offset if it is intact: label, where the content begins, its bytes."""
    head = os.pread(descriptor, HEADER.size, offset)
    if len(head) < HEADER.size:
        return None
    magic, label_size, content_size, checksum = HEADER.unpack(head)
    begin = offset + HEADER.size + label_size
    if magic != MAGIC or label_size > LABEL_BYTES or begin + content_size > size:
        return None
    words = os.pread(descriptor, label_size, offset + HEADER.size)
    label = _label(words, content_size)
    if label is None:
        return None
    crc = zlib.crc32(words)
    for start in range(0, content_size, BLOCK):
        crc = zlib.crc32(os.pread(descriptor, min(BLOCK, content_size - start), begin + start), crc)
    return (label, begin, content_size) if crc == checksum else None


def _label(words: bytes, content_size: int) -> Label | None:
    """A label that means something and fits its content."""
    try:
        label = msgspec.json.decode(words, type=Label)
        return label if not label.path or _fits(label, content_size) else None
    except (msgspec.MsgspecError, RecursionError, TypeError, ValueError, OverflowError, SyntaxError):
        return None


def _fits(label: Label, content_size: int) -> bool:
    declared, dtype = field_at(label.path), np.dtype(label.dtype)
    own = label.path.startswith(EXTRA) and dtype.kind in PLAIN_KINDS and dtype.itemsize > 0
    ours = declared is not None and grows(declared) != label.constant and dtype == np.dtype(declared.dtype)
    if not harmless(label.path) or not (own or ours):
        return False
    if len(label.shape) > DIMENSIONS or any(not 0 <= length < 2**48 for length in label.shape):
        return False
    if not label.constant and (not label.shape or not 0 <= label.start < 2**48):
        return False
    row = label.shape if label.constant else label.shape[1:]
    return prod(row) * dtype.itemsize <= ROW_BYTES and prod(label.shape) * dtype.itemsize == content_size


def _next_magic(descriptor: int, offset: int, size: int) -> int:
    """Where the magic stands next, or the end of the file."""
    while offset < size:
        block = os.pread(descriptor, SEARCH_BLOCK, offset)
        found = block.find(MAGIC)
        if found >= 0:
            return offset + found
        if len(block) < SEARCH_BLOCK:
            return size
        offset += SEARCH_BLOCK - len(MAGIC) + 1
    return size


def _claimed(descriptor: int, offset: int, size: int) -> int:
    """Bytes that checking the record at an offset will read."""
    head = os.pread(descriptor, HEADER.size, offset)
    if len(head) < HEADER.size:
        return 0
    _, label_size, content_size, _ = HEADER.unpack(head)
    claimed = HEADER.size + label_size + content_size
    return int(claimed) if offset + claimed <= size else 0
