"""Writing of episode files, and reading of whole ones; the only module that writes HDF5 files.

An episode file is built in memory, or in a temporary file beside its destination if it may be large. It is then synced
and renamed to its final name. If HDF5 wrote directly to a full disk, its library would crash the whole process, and a
killed writer would leave a file that cannot be opened. This way an episode is either whole or absent. Equal episodes
give equal bytes, whichever way they are written: HDF5's object times are not stored, and the encoding of a chunk
depends on its content only (`svfl_data.storage.chunk_encoding`).

A seal, the SHA-256 of all bytes before it, follows the HDF5 content. HDF5 readers ignore the seal. The reader of this
package checks it before anything else, because HDF5 may read damaged metadata without noticing. The module
`svfl_data.storage.header` describes how a file is read.
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

from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.episode import Episode, Meta, canonical_json
from svfl_data.schema.field import Field
from svfl_data.storage.chunk_encoding import LEVEL, Encoding
from svfl_data.storage.header import FORMAT, FORMAT_VERSION
from svfl_data.storage.metadata import JSON_ATTRIBUTES, PLAIN_ATTRIBUTES, checked_meta
from svfl_data.storage.reader import read_episode as read_episode  # the counterpart of `write_episode`
from svfl_data.storage.reader import read_unsealed as read_unsealed
from svfl_data.storage.seal import SEAL_SIZE as SEAL_SIZE  # imported for users of this module
from svfl_data.storage.seal import file_seal, seal
from svfl_data.storage.sink import Sink, write_all
from svfl_data.system.atomic_io import write_atomically

STREAM_CHUNK = 1024  # rows per chunk of a stream
CHUNK_BYTES = 2**20  # largest size of a chunk of a stream, unless one row is larger
BLOCK_BYTES = 2**20  # bytes that a thread encodes at once
THREADS = 4  # most threads that encode an episode which is sealed; more would only wait for HDF5 and the disk
TEXT = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
SCALAR = h5py.h5s.create(h5py.h5s.SCALAR)


class Rows(Protocol):
    """An array that may be larger than memory: a NumPy array, or an object whose slices of rows are NumPy arrays."""

    @property
    def dtype(self) -> np.dtype:
        """NumPy dtype of the elements."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""

    def __getitem__(self, rows: slice, /) -> np.ndarray: ...


def episode_bytes(episode: Episode) -> bytes:
    """Return the content of a sealed HDF5 file that holds an episode; equal episodes give equal bytes."""
    buffer = io.BytesIO()
    _write_hdf5(buffer, episode.meta, episode.arrays, episode.declarations, None)
    content = buffer.getvalue()
    return content + seal(content)


def write_sealed(
    descriptor: int, meta: Meta, arrays: Mapping[str, Rows], declarations: Declarations = STANDARD
) -> None:
    """Write a sealed episode of any length into a new file and sync the file.

    A few threads encode the arrays, and only a few blocks are in memory at a time. The bytes are the same as those of
    `episode_bytes` for the same content. They are read from the file again to compute the seal.

    Args:
        descriptor: Descriptor of an empty file that is open for reading and writing.
        meta: Metadata of the episode.
        arrays: Arrays by dataset path. They must form a valid episode, which is not checked here.
        declarations: Declarations of the arrays.

    Raises:
        OSError: If the disk refuses; the file then holds nothing of use.
    """
    sink = Sink(descriptor)
    encoders = ThreadPoolExecutor(min(THREADS, os.cpu_count() or 1), "encode")
    with encoders, ThreadPoolExecutor(1) as thread:  # Ctrl-C interrupts the main thread, never HDF5's
        try:
            thread.submit(_write_hdf5, sink, meta, arrays, declarations, encoders).result()
        except BaseException as error:
            sink.error = sink.error or error
    if sink.error is not None:
        raise sink.error
    size = sink.seek(0, os.SEEK_END)
    write_all(descriptor, memoryview(file_seal(descriptor, size)), size)
    os.fsync(descriptor)


def largest_size(arrays: Mapping[str, Rows], declarations: Declarations = STANDARD) -> int:
    """Return an upper bound of the size of an episode on disk, [bytes], for messages.

    The real size is usually much smaller, because of compression.
    """
    images = {path: declarations.image(path) for path in arrays}
    chunks = sum(
        array.shape[0] // _chunk_rows(images[path], array) + 1 for path, array in arrays.items() if array.shape
    )
    return sum(_bytes(array) for array in arrays.values()) + 256 * chunks + 2**14 * (len(arrays) + 1)


def _bytes(array: Rows) -> int:
    return int(np.prod(array.shape, dtype=np.int64)) * array.dtype.itemsize


def _write_hdf5(
    target: BinaryIO | Sink, meta: Meta, arrays: Mapping[str, Rows], declarations: Declarations,
    encoders: ThreadPoolExecutor | None,
) -> None:  # fmt: skip
    meta = checked_meta(meta)
    with h5py.File(target, "w") as file:
        _write_text(file, "format", FORMAT)
        _write_text(file, "format_version", FORMAT_VERSION)
        for key in PLAIN_ATTRIBUTES:
            file.attrs[key] = getattr(meta, key)
        for key in JSON_ATTRIBUTES:
            _write_text(file, key, canonical_json(getattr(meta, key)))
        for path in sorted(arrays):
            _write_array(file, path, arrays[path], declarations.at(path), target, encoders)


def _write_array(
    file: h5py.File, path: str, array: Rows, field: Field | None, target: BinaryIO | Sink,
    encoders: ThreadPoolExecutor | None,
) -> None:  # fmt: skip
    if array.shape and _bytes(array):
        image = field is not None and field.image
        encoding = Encoding(array.dtype, (_chunk_rows(image, array), *array.shape[1:]))
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
    for name, text in field.attributes.items() if field else ():
        _write_text(dataset, name, text)


def _encoded(array: Rows, encoding: Encoding, encoders: ThreadPoolExecutor | None) -> Iterator[list[bytes]]:
    """Encode an array and yield its chunks in order, a block of chunks at a time, while threads encode later blocks."""
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
    """Write a text attribute as ``owner.attrs[name] = text`` does, in half the time; an episode has about ninety."""
    attribute = h5py.h5a.create(owner.id, name.encode(), TEXT, SCALAR)
    attribute.write(np.array(text, dtype=h5py.string_dtype()))


def _chunk_rows(image: bool, array: Rows) -> int:
    """Return the number of rows per chunk: one for images, and for streams about as many as are read at once."""
    if image:
        return 1
    return max(1, min(array.shape[0], STREAM_CHUNK, CHUNK_BYTES * array.shape[0] // max(1, _bytes(array))))


def write_episode(episode: Episode, path: Path) -> None:
    """Write an episode so that the file is either whole or absent.

    Args:
        episode: Episode to write.
        path: Path of the file. An existing file is replaced.

    Raises:
        StorageError: If the disk is full, read-only or refuses for another reason; nothing is left behind.

    Example:
        >>> from pathlib import Path
        >>> write_episode(dataset[0], Path("copy.hdf5"))
        >>> read_episode("copy.hdf5").meta.index
        0
    """
    write_atomically(path, episode_bytes(episode))


def resealed_bytes(path: Path, entry: dict[str, Any]) -> bytes:
    """Return the content of a new sealed file for an episode whose file other software has changed.

    Anything that other software added is left out, except declared arrays and arrays below ``extra/``.

    Args:
        path: Path of a valid episode file without a seal.
        entry: Entry to add to the history of the episode.

    Raises:
        FormatError: If the file is not a readable episode.
        FieldError: If a field is missing or does not fit its declaration.
    """
    episode = read_unsealed(path)
    meta = dataclasses.replace(episode.meta, history=[*episode.meta.history, entry])
    return episode_bytes(Episode(meta, episode.arrays, episode.name, episode.declarations))
