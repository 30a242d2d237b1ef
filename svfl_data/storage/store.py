"""Writing episode files, and reading whole ones; the only module that writes HDF5.

A file is built in memory, or in a file beside it where it may be large, then synced and given its name. Writing HDF5
straight to a full disk makes the HDF5 library crash the whole process, and a killed writer leaves a file that cannot be
opened; this way an episode is either whole or absent. Equal episodes give equal bytes, whichever way they were written:
HDF5's object times are not stored, and chunks are encoded by their content only (`svfl_data.storage.chunk_encoding`).

Behind the HDF5 content stands a seal, a SHA-256 of all bytes before it. HDF5 readers ignore it; ours checks it before
anything else, because damaged metadata can be read as if nothing had happened. How a file is read:
`svfl_data.storage.header`.
"""

import dataclasses
import io
import os
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import h5py
import numpy as np

from svfl_data.schema.episode import Episode, Meta, canonical_json
from svfl_data.schema.fields import field_at
from svfl_data.storage.chunk_encoding import LEVEL, Encoding
from svfl_data.storage.header import FORMAT, FORMAT_VERSION, MEANING
from svfl_data.storage.metadata import JSON_ATTRIBUTES, PLAIN_ATTRIBUTES, checked_meta
from svfl_data.storage.reader import read_episode as read_episode  # the other half of `write_episode`
from svfl_data.storage.reader import read_unsealed as read_unsealed
from svfl_data.storage.seal import SEAL_SIZE as SEAL_SIZE  # for readers
from svfl_data.storage.seal import file_seal, seal
from svfl_data.storage.sink import Sink, write_all
from svfl_data.system.atomic_io import write_atomically

STREAM_CHUNK = 1024  # rows per chunk of a stream
CHUNK_BYTES = 2**20  # and no more than this, unless one row is larger
BLOCK_BYTES = 2**20  # encoded by a thread at once
THREADS = 4  # of an episode that is sealed, at most; more would wait for HDF5 and the disk
TEXT = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
SCALAR = h5py.h5s.create(h5py.h5s.SCALAR)


class Rows(Protocol):
    """An array that may be larger than memory: a NumPy array, or anything that gives slices of rows as such."""

    @property
    def dtype(self) -> np.dtype:
        """Type of its numbers."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its sizes."""

    def __getitem__(self, rows: slice, /) -> np.ndarray: ...


def episode_bytes(episode: Episode) -> bytes:
    """The episode as the content of a sealed HDF5 file; equal episodes give equal bytes."""
    buffer = io.BytesIO()
    _write_hdf5(buffer, episode.meta, episode.arrays, None)
    content = buffer.getvalue()
    return content + seal(content)


def write_sealed(descriptor: int, meta: Meta, arrays: Mapping[str, Rows]) -> None:
    """Write a sealed episode of any length into a new file and sync it, with a few cores; memory holds a few blocks.

    The bytes are those of `episode_bytes` for the same content. What is written is read again for the seal.

    Args:
        descriptor: The file: empty, open for reading and writing.
        meta: What the episode is about.
        arrays: Dataset path to array; must be a valid episode, which is not checked here.

    Raises:
        OSError: If the disk refuses; the file then holds nothing of use.
    """
    sink = Sink(descriptor)
    encoders = ThreadPoolExecutor(min(THREADS, os.cpu_count() or 1), "encode")
    with encoders, ThreadPoolExecutor(1) as thread:  # Ctrl-C interrupts the main thread, never HDF5 in its own
        try:
            thread.submit(_write_hdf5, sink, meta, arrays, encoders).result()
        except BaseException as error:
            sink.error = sink.error or error
    if sink.error is not None:
        raise sink.error
    size = sink.seek(0, os.SEEK_END)
    write_all(descriptor, memoryview(file_seal(descriptor, size)), size)
    os.fsync(descriptor)


def largest_size(arrays: Mapping[str, Rows]) -> int:
    """Upper bound of the bytes that an episode takes on disk, for messages; compression usually saves most of it."""
    chunks = sum(array.shape[0] // _chunk_rows(path, array) + 1 for path, array in arrays.items() if array.shape)
    return sum(_bytes(array) for array in arrays.values()) + 256 * chunks + 2**14 * (len(arrays) + 1)


def _bytes(array: Rows) -> int:
    return int(np.prod(array.shape, dtype=np.int64)) * array.dtype.itemsize


def _write_hdf5(
    target: BinaryIO | Sink, meta: Meta, arrays: Mapping[str, Rows], encoders: ThreadPoolExecutor | None
) -> None:
    meta = checked_meta(meta)
    with h5py.File(target, "w") as file:
        _write_text(file, "format", FORMAT)
        _write_text(file, "format_version", FORMAT_VERSION)
        for key in PLAIN_ATTRIBUTES:
            file.attrs[key] = getattr(meta, key)
        for key in JSON_ATTRIBUTES:
            _write_text(file, key, canonical_json(getattr(meta, key)))
        for path in sorted(arrays):
            _write_array(file, path, arrays[path], target, encoders)


def _write_array(
    file: h5py.File, path: str, array: Rows, target: BinaryIO | Sink, encoders: ThreadPoolExecutor | None
) -> None:
    if array.shape and _bytes(array):
        encoding = Encoding(array.dtype, (_chunk_rows(path, array), *array.shape[1:]))
        dataset = file.create_dataset(
            path, shape=array.shape, dtype=array.dtype, chunks=encoding.chunk, compression="gzip",
            compression_opts=LEVEL, shuffle=encoding.shuffled,
        )  # fmt: skip
        row, none = 0, (0,) * len(array.shape[1:])
        for block in _encoded(array, encoding, encoders):
            for content in block:
                dataset.id.write_direct_chunk((row, *none), content)
                row += encoding.chunk[0]
            if isinstance(target, Sink) and target.error:
                raise target.error
    else:
        dataset = file.create_dataset(path, data=array[:] if array.shape else np.asarray(array))
    field = field_at(path)
    if field:
        for name in MEANING:
            _write_text(dataset, name, getattr(field, name))
        _write_text(dataset, "doc", field.doc)
        if field.components:
            _write_text(dataset, "components", ",".join(field.components))


def _encoded(array: Rows, encoding: Encoding, encoders: ThreadPoolExecutor | None) -> Iterator[list[bytes]]:
    """The chunks of an array in order, a block of them at a time; a few blocks are being encoded meanwhile."""
    rows, chunk = array.shape[0], encoding.chunk[0]
    step = max(1, BLOCK_BYTES * rows // _bytes(array) // chunk) * chunk

    def encode(start: int) -> list[bytes]:
        return encoding.encode(array[start : start + step])

    if encoders is None or rows <= step:
        yield from map(encode, range(0, rows, step))
        return
    ahead: deque[Future[list[bytes]]] = deque()
    for start in range(0, rows, step):
        ahead.append(encoders.submit(encode, start))
        if len(ahead) > 2 * THREADS:
            yield ahead.popleft().result()
    while ahead:
        yield ahead.popleft().result()


def _write_text(owner: h5py.File | h5py.Dataset, name: str, text: str) -> None:
    """What ``owner.attrs[name] = text`` does, in half the time: an episode has some ninety of them."""
    attribute = h5py.h5a.create(owner.id, name.encode(), TEXT, SCALAR)
    attribute.write(np.array(text, dtype=h5py.string_dtype()))


def _chunk_rows(path: str, array: Rows) -> int:
    """Rows per chunk: one image, or as much of a stream as is read at once."""
    field = field_at(path)
    if field and field.image:
        return 1
    return max(1, min(array.shape[0], STREAM_CHUNK, CHUNK_BYTES * array.shape[0] // max(1, _bytes(array))))


def write_episode(episode: Episode, path: Path) -> None:
    """Write an episode so that the file is either whole or absent.

    Args:
        episode: What to write.
        path: The file; replaced if it exists.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses; nothing is left behind.

    Example:
        >>> from pathlib import Path
        >>> write_episode(dataset[0], Path("copy.hdf5"))
        >>> read_episode("copy.hdf5").meta.index
        0
    """
    write_atomically(path, episode_bytes(episode))


def resealed_bytes(path: Path, entry: dict[str, Any]) -> bytes:
    """The episode of a file that other software has changed, written anew and sealed.

    What other software added beside declared arrays and those below ``extra/`` is not kept.

    Args:
        path: A valid episode file without a seal.
        entry: What to add to its history.

    Raises:
        SvflError: As `read_unsealed`.
    """
    episode = read_unsealed(path)
    meta = dataclasses.replace(episode.meta, history=[*episode.meta.history, entry])
    return episode_bytes(Episode(meta, episode.arrays, episode.name))
