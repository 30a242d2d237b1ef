"""The journal: the append-only file of an episode that is being recorded, readable however its writer ends.

A journal is a sequence of records. Each record has a header (`HEADER`: magic, size of the label, size of the content,
CRC-32 of both), a label (JSON, `Label`) and a content. The label ``{"meta", "declared"}`` opens the journal. The label
``{"path", "dtype", "shape", "start"}`` gives rows of a stream from a certain row on; with ``"constant"`` in place of
``"start"`` it gives a whole array. ``{"gap": ...}`` declares missing readings, and ``{"fault": ...}`` states what went
wrong. ``{"end": ...}`` closes the journal with the final metadata. Nothing is ever overwritten, so an intact record
stays intact. After a damaged record, reading continues with the next intact one. Since rows are numbered, it is known
which rows are missing between them.

A journal may come from an untrusted source, so everything in it is checked before use: labels against their types, and
sizes against the file.
"""

import os
import struct
import zlib
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import prod
from typing import Any

import msgspec
import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.declarations import STANDARD, Declarations, stored_declarations
from svfl_data.schema.episode import Meta
from svfl_data.schema.fields import EXTRA, PLAIN_KINDS, harmless

HEADER = struct.Struct("<4sIQI")
MAGIC = b"SVJ1"
SUFFIX = ".journal"
BLOCK = 2**22
"""Number of bytes that are read at once, so that memory does not grow with the size of a record."""
LABEL_BYTES = 2**22
"""Largest size of a label, [bytes]. The label of metadata holds the whole configuration."""
ARRAYS, WORDS = 1000, 10_000
"""Largest number of arrays of an episode, and largest number of declared gaps and of faults."""
ROW_BYTES = 2**32
"""Largest size of a row, [bytes]."""
DIMENSIONS = 16
"""Largest number of dimensions of an array."""
SEARCHED, SEARCH_BLOCK = 8, 2**16
"""Limit of the bytes that are read to find intact records after damage, in multiples of the file's size, and number of
bytes that are read at once in this search."""


class Label(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Label of a record, which stands before its content. The attributes that are set tell the kind of the record.

    Attributes:
        meta: Metadata with which the journal was opened.
        declared: Declarations of the arrays that are not standard, by dataset path: the dtype, and the attributes that
            the HDF5 file will have (`svfl_data.schema.field.attributes`). They stand in the first record.
        end: Final metadata of the episode.
        gap: Arguments of a `svfl_data.recording.recording_clocks.Gap`.
        fault: Description of a fault of the recording, in words.
        path: Dataset path of an array; empty in records of another kind.
        dtype: Dtype of the array, as NumPy writes it in ``dtype.str``.
        shape: Shape of the rows in this record, or of the whole array if `constant` is True.
        start: Number of the first row in this record; absent for constants.
        constant: Whether the record holds a whole array that the episode has once.
    """

    meta: Meta | None = None
    declared: dict[str, dict[str, str]] = {}
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
    """Rows of a stream in a journal, as an array whose slices are read when they are asked for.

    Attributes:
        descriptor: Descriptor of the journal, open for reading.
        dtype: NumPy dtype of the elements.
        row_shape: Shape of one row.
        starts: Number of the first row of each contiguous piece.
        offsets: Position of the content of each piece in the file, [bytes].
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
        """Shape of the whole array."""
        return (self.rows, *self.row_shape)

    @property
    def row_bytes(self) -> int:
        """Size of one row, [bytes]."""
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
"""Ranges of rows, each given by its first row and the row after its last one; disjoint and ascending."""


@dataclass
class Stream:
    """The intact rows of a stream in a journal, numbered in the order in which they were appended.

    Attributes:
        descriptor: Descriptor of the journal, open for reading.
        dtype: NumPy dtype of the elements.
        row_shape: Shape of one row.
    """

    descriptor: int
    dtype: np.dtype
    row_shape: tuple[int, ...]
    _firsts: "array[int]" = field(default_factory=lambda: array("q"))
    _stops: "array[int]" = field(default_factory=lambda: array("q"))
    _offsets: "array[int]" = field(default_factory=lambda: array("q"))

    def add(self, start: int, rows: int, offset: int) -> None:
        """Add those rows of a record that are new; an interrupted record may have been written again with more rows.

        Args:
            start: Number of the first row of the record.
            rows: Number of rows in the record.
            offset: Position of the record's content in the file, [bytes].
        """
        known = self._stops[-1] if self._stops else 0
        first = max(start, known)
        if start + rows > first:
            self._firsts.append(first)
            self._stops.append(start + rows)
            self._offsets.append(offset + (first - start) * prod(self.row_shape) * self.dtype.itemsize)

    @property
    def spans(self) -> Spans:
        """Ranges of the intact rows."""
        spans: Spans = []
        for first, stop in zip(self._firsts, self._stops, strict=True):
            if spans and spans[-1][1] == first:
                spans[-1] = spans[-1][0], stop
            else:
                spans.append((first, stop))
        return spans

    def rows(self, spans: Iterable[tuple[int, int]] | None = None) -> JournalRows:
        """Return some intact rows as one array.

        Args:
            spans: Ranges of the wanted rows, disjoint and ascending. They must lie within the ranges of the property
                `spans`. None means all intact rows.
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
    """The intact content of a journal.

    Attributes:
        meta: Metadata with which the journal was opened; None if they are not intact.
        end: Final metadata; None if the writer did not begin to seal the episode, or appended more rows after that.
        constants: Arrays that the episode has once, by dataset path.
        streams: Intact rows of the arrays that grow, by dataset path.
        gaps: Declared gaps, as arguments of `svfl_data.recording.recording_clocks.Gap`. A later gap of the same stream
            with the same start replaces an earlier one.
        faults: Descriptions of the faults of the recording, in words.
        damaged: First byte and number of bytes of each damaged part of the file.
        size: Size of the file, [bytes].
    """

    size: int
    meta: Meta | None = None
    declarations: Declarations = STANDARD
    end: Meta | None = None
    constants: dict[str, np.ndarray] = field(default_factory=dict)
    streams: dict[str, Stream] = field(default_factory=dict)
    gaps: list[dict[str, Any]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    damaged: list[tuple[int, int]] = field(default_factory=list)

    @property
    def incomplete(self) -> bool:
        """Whether something is missing before intact content; a killed writer leaves damage only at the end."""
        every = [stream.spans for stream in self.streams.values()]
        holes = any(len(spans) > 1 or spans[0][0] > 0 for spans in every if spans)
        return holes or any(start + size < self.size for start, size in self.damaged)


def read_journal(descriptor: int) -> Journal:
    """Read the intact content of a journal; rows stay on disk, so memory does not grow with the episode.

    Args:
        descriptor: Descriptor of the journal, open for reading. It must stay open while the streams are used.
    """
    journal = Journal(size=os.fstat(descriptor).st_size)
    known = 0
    for label, offset, size, begin in _records(descriptor, journal):
        if begin > known:
            journal.damaged.append((known, begin - known))
        known = offset + size
        if label.path:
            _add_array(journal, label, descriptor, offset, size)
        elif label.end is not None:
            journal.end = label.end
        elif label.meta is not None and journal.meta is None:
            journal.meta, journal.declarations = label.meta, _declarations(label)
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
        journal.end = None  # the writer could not seal the episode and continued to record
    else:
        journal.damaged.append((offset, size))


def _declarations(label: Label) -> Declarations:
    return stored_declarations({path: (texts.get("dtype", ""), texts) for path, texts in label.declared.items()})


def _records(descriptor: int, journal: Journal) -> Iterator[tuple[Label, int, int, int]]:
    """Yield the intact records: label, position and size of the content, and position of the record, in bytes."""
    size = journal.size
    offset, left = 0, SEARCHED * size + 1000 * SEARCH_BLOCK
    while offset < size:
        found = _record(descriptor, offset, journal)
        if found:
            label, begin, content = found
            yield label, begin, content, offset
            offset = begin + content
            continue
        at = _next_magic(descriptor, offset + 1, size)
        left -= at - offset + SEARCH_BLOCK + _claimed(descriptor, at, size)
        if left < 0:
            return  # the file seems made to be searched without end
        offset = at


def _record(descriptor: int, offset: int, journal: Journal) -> tuple[Label, int, int] | None:
    """Return label, position and size of the content of the record at an offset; None if the record is not intact."""
    head = os.pread(descriptor, HEADER.size, offset)
    if len(head) < HEADER.size:
        return None
    magic, label_size, content_size, checksum = HEADER.unpack(head)
    begin = offset + HEADER.size + label_size
    if magic != MAGIC or label_size > LABEL_BYTES or begin + content_size > journal.size:
        return None
    words = os.pread(descriptor, label_size, offset + HEADER.size)
    label = _label(words, content_size, journal.declarations)
    if label is None:
        return None
    crc = zlib.crc32(words)
    for start in range(0, content_size, BLOCK):
        crc = zlib.crc32(os.pread(descriptor, min(BLOCK, content_size - start), begin + start), crc)
    return (label, begin, content_size) if crc == checksum else None


def _label(words: bytes, content_size: int, declarations: Declarations) -> Label | None:
    """Parse a label; None if the label is not valid or does not fit the size of its content."""
    try:
        label = msgspec.json.decode(words, type=Label)
        _declarations(label)
        return label if not label.path or _fits(label, content_size, declarations) else None
    except (msgspec.MsgspecError, RecursionError, TypeError, ValueError, OverflowError, SyntaxError, FieldError):
        return None


def _fits(label: Label, content_size: int, declarations: Declarations) -> bool:
    declared, dtype = declarations.at(label.path), np.dtype(label.dtype)
    own = label.path.startswith(EXTRA) and dtype.kind in PLAIN_KINDS and dtype.itemsize > 0
    ours = declared is not None and declared.grows != label.constant and dtype == np.dtype(declared.dtype)
    if not harmless(label.path) or not (own or ours):
        return False
    if len(label.shape) > DIMENSIONS or any(not 0 <= length < 2**48 for length in label.shape):
        return False
    if not label.constant and (not label.shape or not 0 <= label.start < 2**48):
        return False
    row = label.shape if label.constant else label.shape[1:]
    return prod(row) * dtype.itemsize <= ROW_BYTES and prod(label.shape) * dtype.itemsize == content_size


def _next_magic(descriptor: int, offset: int, size: int) -> int:
    """Return the position of the next magic at or after an offset, or the size of the file if there is none."""
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
    """Return how many bytes must be read to check the record at an offset."""
    head = os.pread(descriptor, HEADER.size, offset)
    if len(head) < HEADER.size:
        return 0
    _, label_size, content_size, _ = HEADER.unpack(head)
    claimed = HEADER.size + label_size + content_size
    return int(claimed) if offset + claimed <= size else 0
