"""Writing episode files, and reading whole ones; the only module that writes HDF5.

A file is built in memory, or in a file beside it where it may be large, then synced and given its name. Writing HDF5
straight to a full disk makes the HDF5 library crash the whole process, and a killed writer leaves a file that cannot be
opened; this way an episode is either whole or absent. Equal episodes give equal bytes, whichever way they were written:
HDF5's object times are not stored, and arrays are always handed over in the same blocks.

Behind the HDF5 content stands a seal, a SHA-256 of all bytes before it. HDF5 readers ignore it; ours checks it before
anything else, because damaged metadata can be read as if nothing had happened. How a file is read: `svfl_data.header`.
"""

import dataclasses
import io
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import h5py
import numpy as np

from svfl_data.atomically import write_atomically
from svfl_data.episode import Episode, Meta, canonical_json
from svfl_data.fields import field_at
from svfl_data.header import FORMAT, FORMAT_VERSION, JSON_ATTRIBUTES, MEANING, PLAIN_ATTRIBUTES
from svfl_data.reader import read_episode as read_episode  # the other half of `write_episode`
from svfl_data.reader import read_unsealed as read_unsealed
from svfl_data.seal import SEAL_SIZE as SEAL_SIZE  # for readers
from svfl_data.seal import file_seal, seal
from svfl_data.sink import Sink, write_all

GZIP_LEVEL = 1  # readable everywhere; higher levels cost more time than they save bytes on rendered images
STREAM_CHUNK = 1024  # rows per chunk of a stream
CHUNK_BYTES = 2**20  # and no more than this, unless one row is larger
BLOCK_BYTES = 2**20  # handed to HDF5 at once
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
    _write_hdf5(buffer, episode.meta, episode.arrays)
    content = buffer.getvalue()
    return content + seal(content)


def write_sealed(descriptor: int, meta: Meta, arrays: Mapping[str, Rows]) -> None:
    """Write a sealed episode of any length into a new file and sync it; memory holds a block at a time.

    The bytes are those of `episode_bytes` for the same content. What is written is read again for the seal.

    Args:
        descriptor: The file: empty, open for reading and writing.
        meta: What the episode is about.
        arrays: Dataset path to array; must be a valid episode, which is not checked here.

    Raises:
        OSError: If the disk refuses; the file then holds nothing of use.
    """
    sink = Sink(descriptor)
    with ThreadPoolExecutor(1) as thread:  # Ctrl-C interrupts the main thread, never HDF5 while it calls the sink
        try:
            thread.submit(_write_hdf5, sink, meta, arrays).result()
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


def _write_hdf5(target: BinaryIO | Sink, meta: Meta, arrays: Mapping[str, Rows]) -> None:
    with h5py.File(target, "w") as file:
        _write_text(file, "format", FORMAT)
        _write_text(file, "format_version", FORMAT_VERSION)
        for key in PLAIN_ATTRIBUTES:
            file.attrs[key] = getattr(meta, key)
        for key in JSON_ATTRIBUTES:
            _write_text(file, key, canonical_json(getattr(meta, key)))
        for path in sorted(arrays):
            _write_array(file, path, arrays[path], target)


def _write_array(file: h5py.File, path: str, array: Rows, target: BinaryIO | Sink) -> None:
    if array.shape and _bytes(array):
        rows = _chunk_rows(path, array)
        dataset = file.create_dataset(
            path, shape=array.shape, dtype=array.dtype, chunks=(rows, *array.shape[1:]), compression="gzip",
            compression_opts=GZIP_LEVEL, shuffle=array.dtype.itemsize > 1, fletcher32=True,
        )  # fmt: skip
        block = max(1, BLOCK_BYTES * array.shape[0] // _bytes(array) // rows) * rows
        for start in range(0, array.shape[0], block):
            dataset[start : start + block] = array[start : start + block]
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
