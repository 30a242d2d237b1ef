"""Opening a sealed episode: once per process its seal is checked and its arrays are located."""

import functools
import hashlib
import io
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from svfl_data.chunks import Extent, Placement, placement, pread
from svfl_data.episode import Meta
from svfl_data.errors import FormatError, SvflError
from svfl_data.fields import EXTRA, field_at
from svfl_data.seal import HDF5_MAGIC, SEAL_MARK, SEAL_SIZE, broken
from svfl_data.store import JSON_ATTRIBUTES, PLAIN_ATTRIBUTES, check_format, check_meaning
from svfl_data.validity import check_arrays

HEADERS_KEPT = 512


@dataclass(frozen=True, eq=False)
class Header:
    """What is known of an episode once it was opened.

    Attributes:
        seal: SHA-256 of its content, in hexadecimal.
        attributes: Of the file, as HDF5 gives them.
        placements: Where each array lies, by dataset path.
    """

    seal: str
    attributes: dict[str, Any]
    placements: dict[str, Placement]


@functools.lru_cache(maxsize=HEADERS_KEPT)
def header(extent: Extent) -> Header:
    """Check the seal and the declared shapes, and find out where everything lies; once per process.

    Raises:
        FormatError: If the episode is damaged, foreign, of another version, or has changed since it was found.
        FieldError: If a field is missing or of another type or shape than declared.
    """
    digest = checked_seal(extent)
    descriptor = extent.open()
    try:
        with h5py.File(_ExtentFile(extent, descriptor), "r") as file:
            attributes = dict(file.attrs)
            check_format(attributes, extent)
            placements = dict(_placements(h5py.h5g.open(file.id, b"/"), "", extent))
        check_arrays({path: _Array(extent, descriptor, found) for path, found in placements.items()}, str(extent))
    except SvflError:
        raise
    except Exception as error:  # whole, but not as we write it: h5py raises nearly anything
        reason = " ".join(str(error).split())
        raise FormatError(f"{extent}: sealed, but not a readable episode ({reason})") from error
    finally:
        os.close(descriptor)
    return Header(digest, attributes, placements)


def checked_seal(extent: Extent) -> str:
    """SHA-256 of an episode's content, in hexadecimal, read and compared with its seal.

    Raises:
        FormatError: If the episode is damaged or was never sealed.
    """
    digest, head, tail = hashlib.sha256(), b"", b""
    for block in extent.blocks():
        head, tail = head or block[: len(HDF5_MAGIC)], tail + block
        digest.update(tail[:-SEAL_SIZE])
        tail = tail[-SEAL_SIZE:]
    if tail != SEAL_MARK + digest.hexdigest().encode() + b"\n":
        raise broken(extent, head, tail, extent.size)
    return digest.hexdigest()


def read_meta(extent: Extent) -> Meta:
    """What an episode is about.

    Raises:
        FormatError: If its attributes are not those of an episode.
    """
    found = header(extent).attributes
    try:
        values = {key: json.loads(found[key]) for key in JSON_ATTRIBUTES}
        values |= {key: np.asarray(found[key]).item() for key in PLAIN_ATTRIBUTES}
        for key, kind in (JSON_ATTRIBUTES | PLAIN_ATTRIBUTES).items():
            if type(values[key]) is not kind:
                raise TypeError(f"attribute {key} is {values[key]!r}, not of type {kind.__name__}")
        return Meta(**values)
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{extent}: sealed, but not a readable episode ({error})") from error


@dataclass(frozen=True, eq=False)
class _Array:
    """An array of an episode that is being opened, for `validity`."""

    extent: Extent
    descriptor: int
    placement: Placement

    @property
    def dtype(self) -> np.dtype:
        return self.placement.dtype

    @property
    def shape(self) -> tuple[int, ...]:
        return self.placement.shape

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, _ = rows.indices(self.shape[0])
        return self.placement.rows(self.extent, self.descriptor, start, stop)

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.placement.value, dtype=dtype)


class _ExtentFile(io.RawIOBase):
    """An extent as a file object, for HDF5."""

    def __init__(self, extent: Extent, descriptor: int) -> None:
        self.extent, self.descriptor, self.position = extent, descriptor, 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self.position, os.SEEK_END: self.extent.size - SEAL_SIZE}[whence]
        self.position = start + offset
        return self.position

    def tell(self) -> int:
        return self.position

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - any writable buffer
        view = memoryview(buffer)
        view[:] = pread(self.extent, self.descriptor, len(view), self.position)
        self.position += len(view)
        return len(view)


def _placements(group: h5py.h5g.GroupID, prefix: str, extent: Extent) -> Iterator[tuple[str, Placement]]:
    """Every array that is declared or the user's own; what else there is comes from a later minor version."""
    for name in group:
        path = prefix + name.decode()
        item = h5py.h5o.open(group, name)
        if isinstance(item, h5py.h5g.GroupID):
            yield from _placements(item, path + "/", extent)
        elif isinstance(item, h5py.h5d.DatasetID) and (field_at(path) or path.startswith(EXTRA)):
            check_meaning(path, h5py.Dataset(item).attrs, extent)
            yield path, placement(item)
