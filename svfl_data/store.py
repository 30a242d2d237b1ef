"""Reading and writing episode files; the only module that knows HDF5.

A file is built in memory, written aside, synced and renamed. Writing HDF5 straight to a full disk makes the HDF5
library crash the whole process, and a killed writer leaves a file that cannot be opened; this way an episode is
either whole or absent. Equal episodes give equal bytes: HDF5's object times are not stored.

Behind the HDF5 content stands a seal, a SHA-256 of all bytes before it. HDF5 readers ignore it; ours checks it before
HDF5 sees a byte, because damaged metadata can be read as if nothing had happened, or keep the library busy for ever.
"""

import hashlib
import io
import json
import os
import tempfile
from pathlib import Path

import h5py
import numpy as np

from svfl_data.episode import Episode, Meta, canonical_json
from svfl_data.errors import FormatError, StorageError, SvflError
from svfl_data.fields import EXTRA, field_at

FORMAT = "svfl-episode"
FORMAT_VERSION = "1.0"
"""Major.minor: readers accept every minor of their own major, since a minor version only adds optional fields."""

GZIP_LEVEL = 1  # readable everywhere; higher levels cost more time than they save bytes on rendered images
STREAM_CHUNK = 1024  # rows per chunk of a stream
JSON_ATTRIBUTES = ("config", "software", "transforms", "annotations", "history")
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"


def episode_bytes(episode: Episode) -> bytes:
    """The episode as the content of a sealed HDF5 file; equal episodes give equal bytes."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = FORMAT_VERSION
        for key in ("task", "index", "seed", "source", "success"):
            file.attrs[key] = getattr(episode.meta, key)
        for key in JSON_ATTRIBUTES:
            file.attrs[key] = canonical_json(getattr(episode.meta, key))
        for path in sorted(episode.arrays):
            _write_array(file, path, episode.arrays[path])
    content = buffer.getvalue()
    return content + _seal(content)


def _write_array(file: h5py.File, path: str, array: np.ndarray) -> None:
    field = field_at(path)
    if array.ndim and array.size:
        rows = 1 if field and field.image else min(len(array), STREAM_CHUNK)
        dataset = file.create_dataset(
            path, data=array, chunks=(rows, *array.shape[1:]), compression="gzip", compression_opts=GZIP_LEVEL,
            shuffle=array.itemsize > 1, fletcher32=True,
        )  # fmt: skip
    else:
        dataset = file.create_dataset(path, data=array)
    if field:
        dataset.attrs["unit"] = field.unit
        dataset.attrs["doc"] = field.doc
        if field.components:
            dataset.attrs["components"] = ",".join(field.components)


def _seal(content: bytes) -> bytes:
    return b"\nsvfl-sha256:" + hashlib.sha256(content).hexdigest().encode() + b"\n"


SEAL_SIZE = len(_seal(b""))
HEX_DIGITS = 65  # and the line's end


def write_episode(episode: Episode, path: Path) -> None:
    """Write an episode so that the file is either whole or absent.

    Args:
        episode: What to write.
        path: The file; replaced if it exists.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses; nothing is left behind.
    """
    write_atomically(path, episode_bytes(episode))


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file aside, sync it to disk and rename it into place.

    Args:
        path: The file; replaced if it exists.
        content: Its bytes.

    Raises:
        StorageError: If the disk is full, read-only or otherwise refuses; nothing is left behind.
    """
    aside = None
    try:
        handle, aside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(aside, 0o644)
        os.replace(aside, path)
        _sync_folder(path.parent)
    except OSError as error:
        raise StorageError(
            f"cannot write {path} ({len(content)} bytes): {error.strerror}; everything written before is intact"
        ) from error
    finally:
        if aside and os.path.exists(aside):
            os.unlink(aside)


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)  # the rename itself survives a power cut
    finally:
        os.close(descriptor)


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
    content = _unsealed(path.read_bytes(), path)
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            _check_format(file, path)
            return Episode(_read_meta(file), _read_arrays(file), name=str(path))
    except SvflError:
        raise
    except Exception as error:  # whole, but not as we write it: h5py raises nearly anything
        reason = " ".join(str(error).split())
        raise FormatError(f"{path}: sealed, but not a readable episode ({reason})") from error


def _unsealed(sealed: bytes, path: Path) -> bytes:
    """The HDF5 content, if it is what was written."""
    content, seal = sealed[:-SEAL_SIZE], sealed[-SEAL_SIZE:]
    if seal == _seal(content):
        return content
    if not sealed.startswith(HDF5_MAGIC):
        raise FormatError(f"{path}: not an episode file (no HDF5 file, {len(sealed)} bytes)")
    if seal.startswith(_seal(b"")[:-HEX_DIGITS]):
        raise FormatError(f"{path}: damaged (its {len(sealed)} bytes do not match its seal)")
    raise FormatError(f"{path}: not a sealed episode: truncated, or written by other software ({len(sealed)} bytes)")


def _check_format(file: h5py.File, path: Path) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise FormatError(f"{path}: an HDF5 file, but not an episode (attribute format is {found!r}, not {FORMAT!r})")
    version = str(file.attrs.get("format_version"))
    if version.split(".")[0] != FORMAT_VERSION.split(".")[0]:
        raise FormatError(f"{path}: format version {version}; this software reads {FORMAT_VERSION.split('.')[0]}.x")


def _read_arrays(file: h5py.File) -> dict[str, np.ndarray]:
    """Every array that is declared or the user's own; what else there is comes from a later minor version."""
    arrays: dict[str, np.ndarray] = {}

    def read(path: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset) and (field_at(path) or path.startswith(EXTRA)):
            arrays[path] = np.asarray(item[()])

    file.visititems(read)
    return arrays


def _read_meta(file: h5py.File) -> Meta:
    return Meta(
        task=str(file.attrs["task"]),
        index=int(file.attrs["index"]),
        seed=int(file.attrs["seed"]),
        source=str(file.attrs["source"]),
        success=bool(file.attrs["success"]),
        **{key: json.loads(file.attrs[key]) for key in JSON_ATTRIBUTES},
    )
