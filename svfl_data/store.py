"""Reading and writing episode files; the only module that knows HDF5.

A file is built in memory, or in a file beside it where it may be large, then synced and given its name. Writing HDF5
straight to a full disk makes the HDF5 library crash the whole process, and a killed writer leaves a file that cannot be
opened; this way an episode is either whole or absent. Equal episodes give equal bytes, whichever way they were written:
HDF5's object times are not stored, and chunks are encoded by their content only (`svfl_data.chunk_encoding`).

Behind the HDF5 content stands a seal, a SHA-256 of all bytes before it. HDF5 readers ignore it; ours checks it before
HDF5 sees a byte, because damaged metadata can be read as if nothing had happened, or keep the library busy for ever.
"""

import io
import json
import os
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import h5py
import numpy as np

from svfl_data.atomically import write_atomically
from svfl_data.chunk_encoding import LEVEL, Encoding
from svfl_data.episode import Episode, Meta, canonical_json
from svfl_data.errors import FieldError, FormatError, SvflError
from svfl_data.fields import EXTRA, field_at
from svfl_data.seal import SEAL_SIZE as SEAL_SIZE  # for readers
from svfl_data.seal import file_seal, seal, unsealed
from svfl_data.sink import Sink, write_all

FORMAT = "svfl-episode"
FORMAT_VERSION = "1.0"
"""Major.minor: readers accept every minor of their own major, since a minor version only adds optional fields."""

STREAM_CHUNK = 1024  # rows per chunk of a stream
CHUNK_BYTES = 2**20  # and no more than this, unless one row is larger
BLOCK_BYTES = 2**20  # encoded by a thread at once
THREADS = 4  # of an episode that is sealed, at most; more would wait for HDF5 and the disk
PLAIN_ATTRIBUTES = {"task": str, "index": int, "seed": int, "source": str, "success": bool}
TEXT = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
SCALAR = h5py.h5s.create(h5py.h5s.SCALAR)
MEANING = ("unit", "axes", "about")
"""Attributes of a dataset without which its numbers mean nothing; they must be as declared."""
JSON_ATTRIBUTES = {"config": dict, "software": dict, "transforms": list, "annotations": list, "history": list}


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
    """
    write_atomically(path, episode_bytes(episode))


def read_episode(path: Path | str) -> Episode:
    """Read a whole episode.

    Args:
        path: An episode file.

    Returns:
        The episode, every array checked against its declaration.

    Raises:
        FormatError: If the file is missing, truncated, damaged, not an episode, or of an unknown version.
        FieldError: If a field is missing or does not fit its declaration.
    """
    path = Path(path)
    if not path.is_file():
        raise FormatError(f"{path}: {'is a folder, not an episode file' if path.is_dir() else 'no such file'}")
    return _read_content(unsealed(path.read_bytes(), path), path)


def read_unsealed(path: Path) -> Episode:
    """Read an episode file that lost its seal to other software.

    Nothing protects from damage here: HDF5 may crash or hang on a damaged file, or read it as if nothing had happened.

    Raises:
        FormatError: If it is not a readable episode.
        FieldError: If a field is missing or does not fit its declaration.
    """
    return _read_content(path.read_bytes(), path)


def _read_content(content: bytes, path: Path) -> Episode:
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            check_format(file.attrs, path)
            return Episode(_read_meta(file), _read_arrays(file, path), name=str(path))
    except SvflError:
        raise
    except Exception as error:  # whole, but not as we write it: h5py raises nearly anything
        reason = " ".join(str(error).split())
        raise FormatError(f"{path}: sealed, but not a readable episode ({reason})") from error


def check_format(attributes: Mapping[str, Any], where: object) -> None:
    """Refuse files that are not episodes, or of another major version.

    Args:
        attributes: Those of the file.
        where: What to name in the error, such as the file.

    Raises:
        FormatError: If the file is another one.
    """
    found = attributes.get("format")
    if found != FORMAT:
        raise FormatError(f"{where}: an HDF5 file, but not an episode (attribute format is {found!r}, not {FORMAT!r})")
    version, ours = str(attributes.get("format_version")), FORMAT_VERSION.split(".")[0]
    if version.split(".")[0] != ours:
        raise FormatError(f"{where}: format version {version}; this software reads {ours}.x")


def _read_arrays(file: h5py.File, where: Path) -> dict[str, np.ndarray]:
    """Every array that is declared or the user's own; what else there is comes from a later minor version."""
    arrays: dict[str, np.ndarray] = {}

    def read(path: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset) and (field_at(path) or path.startswith(EXTRA)):
            check_meaning(path, item.attrs, where)
            arrays[path] = np.asarray(item[()])

    file.visititems(read)
    return arrays


def check_meaning(path: str, attributes: Mapping[str, Any], where: object) -> None:
    """Refuse numbers of another unit, in other axes or about another point than declared.

    Args:
        path: Dataset path.
        attributes: Those of the dataset in the file.
        where: What to name in the error, such as the file.

    Raises:
        FieldError: If one differs from the field's declaration.
    """
    field = field_at(path)
    for name in MEANING if field else ():
        found, expected = attributes.get(name), getattr(field, name)
        if found != expected:
            raise FieldError(f"{where}: field {path} has {name} {found!r}, expected {expected!r}")


def _read_meta(file: h5py.File) -> Meta:
    values = {key: json.loads(file.attrs[key]) for key in JSON_ATTRIBUTES}
    values |= {key: np.asarray(file.attrs[key]).item() for key in PLAIN_ATTRIBUTES}
    for key, kind in (JSON_ATTRIBUTES | PLAIN_ATTRIBUTES).items():
        if type(values[key]) is not kind:
            raise TypeError(f"attribute {key} is {values[key]!r}, not of type {kind.__name__}")
    return Meta(**values)


def resealed_bytes(content: bytes, entry: dict[str, Any]) -> bytes:
    """HDF5 content that other software has changed, sealed again, with an entry added to its history.

    Args:
        content: A valid episode without a seal.
        entry: What to add to the attribute ``history``.
    """
    buffer = io.BytesIO(content)
    with h5py.File(buffer, "r+") as file:
        file.attrs["history"] = canonical_json([*json.loads(file.attrs["history"]), entry])
    changed = buffer.getvalue()
    return changed + seal(changed)
