"""Reading and writing episode files; the only module that knows HDF5.

A file is built in memory, written aside, synced and renamed. Writing HDF5 straight to a full disk makes the HDF5
library crash the whole process, and a killed writer leaves a file that cannot be opened; this way an episode is
either whole or absent. Equal episodes give equal bytes: HDF5's object times are not stored.
"""

import hashlib
import io
import json
import os
import tempfile
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np

from svfl_data.episode import Episode, Meta, canonical_json
from svfl_data.errors import FormatError, StorageError, SvflError
from svfl_data.fields import FIELDS, Field

FORMAT = "svfl-episode"
FORMAT_VERSION = "1.0"
"""Major.minor: readers accept every minor of their own major, since a minor version only adds optional fields."""

GZIP_LEVEL = 1  # readable everywhere; higher levels cost more time than they save bytes on rendered images
STREAM_CHUNK = 1024  # rows per chunk of a stream


def episode_bytes(episode: Episode) -> bytes:
    """The episode as the content of an HDF5 file; equal episodes give equal bytes."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["sha256"] = _digest(episode.meta, episode.arrays)
        for key in ("task", "index", "seed", "source", "success"):
            file.attrs[key] = getattr(episode.meta, key)
        file.attrs["config"] = canonical_json(episode.meta.config)
        file.attrs["software"] = canonical_json(episode.meta.software)
        for field in FIELDS:
            if field.name in episode.arrays:
                _write_field(file, field, episode.arrays[field.name])
    return buffer.getvalue()


def _write_field(file: h5py.File, field: Field, array: np.ndarray) -> None:
    if array.ndim and array.size:
        rows = 1 if field.image else min(len(array), STREAM_CHUNK)
        dataset = file.create_dataset(
            field.path, data=array, chunks=(rows, *array.shape[1:]), compression="gzip", compression_opts=GZIP_LEVEL,
            shuffle=array.itemsize > 1, fletcher32=True,
        )  # fmt: skip
    else:
        dataset = file.create_dataset(field.path, data=array)
    dataset.attrs["unit"] = field.unit
    dataset.attrs["doc"] = field.doc
    if field.components:
        dataset.attrs["components"] = ",".join(field.components)


def _digest(meta: Meta, arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 of everything an episode says: HDF5 has no checksum for attributes and small arrays."""
    digest = hashlib.sha256(canonical_json(asdict(meta)).encode())
    for field in FIELDS:
        if field.name in arrays:
            array = arrays[field.name]
            digest.update(f"{field.name} {array.dtype.str} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


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
        FormatError: If the file is missing, truncated, not an episode, or of an unknown version.
        FieldError: If a field is missing or does not fit its declaration.
    """
    path = Path(path)
    if not path.is_file():
        raise FormatError(f"{path}: {'is a folder, not an episode file' if path.is_dir() else 'no such file'}")
    content = path.read_bytes()
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            _check_format(file, path)
            meta, arrays, digest = _read_meta(file), _read_arrays(file, path), str(file.attrs["sha256"])
    except SvflError:
        raise
    except Exception as error:  # damaged metadata makes h5py raise nearly anything
        reason = " ".join(str(error).split())
        raise FormatError(f"{path}: truncated, damaged or no HDF5 file ({len(content)} bytes; {reason})") from error
    episode = Episode(meta, arrays, name=str(path))
    if digest != _digest(meta, arrays):
        raise FormatError(f"{path}: damaged (the content does not match its sha256)")
    return episode


def _check_format(file: h5py.File, path: Path) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise FormatError(f"{path}: an HDF5 file, but not an episode (attribute format is {found!r}, not {FORMAT!r})")
    version = str(file.attrs.get("format_version"))
    if version.split(".")[0] != FORMAT_VERSION.split(".")[0]:
        raise FormatError(f"{path}: format version {version}; this software reads {FORMAT_VERSION.split('.')[0]}.x")


def _read_arrays(file: h5py.File, path: Path) -> dict[str, np.ndarray]:
    arrays = {}
    for field in FIELDS:
        if field.path in file:
            try:
                arrays[field.name] = np.asarray(file[field.path][()])
            except (OSError, RuntimeError) as error:
                raise FormatError(f"{path}: field {field.path} is damaged ({str(error).splitlines()[0]})") from error
    return arrays


def _read_meta(file: h5py.File) -> Meta:
    return Meta(
        task=str(file.attrs["task"]),
        index=int(file.attrs["index"]),
        seed=int(file.attrs["seed"]),
        source=str(file.attrs["source"]),
        success=bool(file.attrs["success"]),
        config=json.loads(file.attrs["config"]),
        software=json.loads(file.attrs["software"]),
    )
