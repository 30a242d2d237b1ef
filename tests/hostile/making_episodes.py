"""How the makers of hostile episodes change a sound one: through h5py, through its low level, or byte by byte."""

import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from tests.hostile.kind import content_of, episode_file, write_resealed


@contextmanager
def reopened(folder: Path, index: int = 0, **options) -> Iterator[h5py.File]:
    """An episode to be changed; sealed again afterwards."""
    path = episode_file(folder, index)
    buffer = io.BytesIO(content_of(path))
    with h5py.File(buffer, "r+", **options) as file:
        yield file
    write_resealed(path, buffer.getvalue())


def replace(file: h5py.File, path: str, **creation) -> h5py.Dataset:
    """Another dataset in place of one, with its attributes; without `data` or `shape`, with its content."""
    old = file[path]
    kept = dict(old.attrs)
    if not {"data", "shape", "external"} & creation.keys():
        creation["data"] = old[()]
    del file[path]
    new = file.create_dataset(path, **creation)
    for name, value in kept.items():
        new.attrs[name] = value
    return new


def put(folder: Path, path: str, value: object) -> None:
    """Give an array another value, shape or type."""
    with reopened(folder) as file:
        if path in file:
            replace(file, path, data=value)
        else:
            file.create_dataset(path, data=value)


def rows(folder: Path, path: str, change) -> None:
    """Change the numbers of an array."""
    with reopened(folder) as file:
        replace(file, path, data=change(file[path][()]))


def zeros_deflated(size: int) -> bytes:
    """What zlib makes of `size` zero bytes (a multiple of 1 MiB), without anybody compressing them."""
    block = 2**20
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    piece = packer.compress(bytes(block)) + packer.flush(zlib.Z_FULL_FLUSH)
    checksum = ((size % 65521) << 16) | 1
    return b"\x78\xda" + piece * (size // block) + b"\x03\x00" + checksum.to_bytes(4, "big")


def bomb(file: h5py.File, path: str, shape, chunks, dtype, chunk: bytes, count: int = 1) -> None:
    """A dataset whose first chunks are given as they stand in the file."""
    dataset = replace(file, path, shape=shape, chunks=chunks, dtype=dtype, compression="gzip") if path in file else (
        file.create_dataset(path, shape=shape, chunks=chunks, dtype=dtype, compression="gzip")
    )  # fmt: skip
    for number in range(count):
        dataset.id.write_direct_chunk((number * chunks[0],) + (0,) * (len(shape) - 1), chunk)


def text(file: h5py.File, name: str, value: bytes | str) -> None:
    """Set a text attribute of the file, whatever its bytes."""
    if name in file.attrs:
        del file.attrs[name]
    file.attrs.create(name, np.bytes_(value) if isinstance(value, bytes) else value, dtype=None)
