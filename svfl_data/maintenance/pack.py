"""Packing of thousands of episode files into a few large shards, and unpacking; the bytes of episodes never change."""

import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

from svfl_data.datasets.dataset import SPLITS, Dataset, inner_folder
from svfl_data.datasets.index import refuse_old
from svfl_data.datasets.shards import shard_files
from svfl_data.errors import DatasetError, FormatError, UsageError
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import checked_seal
from svfl_data.system.atomic_io import write_atomically, written_aside
from svfl_data.system.progress import progress
from svfl_data.system.regular_file import read_regular, refuse_link
from svfl_data.system.side_files import SIZE_LIMIT

SHARD_BYTES = 2**30
"""Default size of a shard, [bytes]. It is large enough for disks and networks to run at full speed, and small enough to
be sent again after a failure."""

SHARD = re.compile(r"shard_(\d{6,18})\.zip", re.ASCII)
EARLIEST = (1980, 1, 1, 0, 0, 0)  # time stamp of every member; real times would make equal shards differ


def pack(dataset: Dataset, out: Path | str, shard_bytes: int = SHARD_BYTES) -> Dataset:
    """Copy a dataset into shards.

    The seal of every episode is checked. After an interruption, the same call continues the work.

    Args:
        dataset: Dataset to copy; its splits are copied, too.
        out: Folder of the new dataset, which must be absent, empty, or the result of an interrupted call.
        shard_bytes: Largest size of a shard, [bytes]. Only a shard with a single episode may be larger.

    Returns:
        The new dataset.

    Raises:
        UsageError: If `shard_bytes` is not positive, or `out` is the folder of `dataset` itself.
        DatasetError: If `out` holds another dataset or other files.
        OldVersionError: If the episodes are of version 1 of the format.
        FormatError: If an episode is damaged; shards that were finished before are kept.
        StorageError: If the disk refuses; shards that were finished before are kept.

    Example:
        >>> len(pack(dataset, "data/packed"))
        2
    """
    if shard_bytes < 1:
        raise UsageError(f"shard_bytes is {shard_bytes}; it must be at least 1")
    refuse_old(dataset)
    target = _copy_of(dataset, out)
    with target.writing():
        missing = sorted(set(dataset.indices) - set(target.indices))
        numbers = (SHARD.fullmatch(file.name) for file in shard_files(target.path))
        number = 1 + max((int(match[1]) for match in numbers if match), default=-1)
        waiting: list[tuple[int, Extent]] = []
        size = 0
        for index in progress(missing, "packing"):
            extent = dataset.extent(index)
            checked_seal(extent)
            if waiting and size + extent.size > shard_bytes:
                _write_shard(target.path / f"shard_{number:06d}.zip", waiting)
                waiting, size, number = [], 0, number + 1
            waiting.append((index, extent))
            size += extent.size
        if waiting:
            _write_shard(target.path / f"shard_{number:06d}.zip", waiting)
    return target


def unpack(dataset: Dataset, out: Path | str) -> Dataset:
    """Copy a dataset into one file per episode, which undoes `pack`.

    Args:
        dataset: Dataset to copy; its splits are copied, too.
        out: Folder of the new dataset, which must be absent, empty, or the result of an interrupted call.

    Returns:
        The new dataset.

    Raises:
        UsageError: If `out` is the folder of `dataset` itself.
        DatasetError: If `out` holds another dataset or other files.
        OldVersionError: If the episodes are of version 1 of the format.
        FormatError: If an episode is damaged; episodes that were written before are kept.
        StorageError: If the disk refuses; episodes that were written before are kept.

    Example:
        >>> len(unpack(dataset, "data/unpacked"))
        2
    """
    refuse_old(dataset)
    target = _copy_of(dataset, out)
    with target.writing():
        for index in progress(sorted(set(dataset.indices) - set(target.indices)), "unpacking"):
            extent = dataset.extent(index)
            checked_seal(extent)
            write_atomically(target.episode_path(index), b"".join(extent.blocks()))
    return target


def _copy_of(dataset: Dataset, out: Path | str) -> Dataset:
    """Create, or open again, a dataset with the same description and splits in another folder."""
    out = Path(out)
    if out.exists() and dataset.path.exists() and out.samefile(dataset.path):
        raise UsageError(f"{out} is the dataset itself; name another folder")
    info = dataset.info
    target = Dataset.create_or_resume(out, info["task"], info["seed"], info["config"], dataset.varies)
    if not (dataset.path / SPLITS).exists():
        return target
    refuse_link(dataset.path / SPLITS)
    for file in sorted((dataset.path / SPLITS).glob("*.json")):
        copy = inner_folder(target.path, SPLITS) / file.name
        content = side_content(file)
        if copy.exists() and side_content(copy) != content:
            raise DatasetError(f"{copy} differs from {file}; name another folder")
        write_atomically(copy, content)
    return target


def side_content(file: Path) -> bytes:
    """Return the bytes of a small file of a dataset, such as a split.

    Args:
        file: Path of the file.

    Raises:
        FormatError: If the file is not an ordinary file, is larger than `SIZE_LIMIT` or cannot be read.
    """
    try:
        return read_regular(file, SIZE_LIMIT)
    except OSError as error:
        raise FormatError(f"{file}: {error.strerror}") from error


def member_info(index: int, size: int) -> zipfile.ZipInfo:
    """Return the entry of an episode in the list of contents of a shard; equal episodes have equal entries.

    Args:
        index: Index of the episode.
        size: Size of the episode, [bytes].
    """
    info = zipfile.ZipInfo(Dataset.file_name(index), EARLIEST)
    info.external_attr = 0o644 << 16
    info.file_size = size
    return info


def _write_shard(file: Path, episodes: Sequence[tuple[int, Extent]]) -> None:
    """Write a shard so that it is either whole or absent."""
    size = sum(extent.size for _, extent in episodes)
    with written_aside(file, size) as whole, zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archive:
        for index, extent in episodes:
            with archive.open(member_info(index, extent.size), "w") as member:
                for block in extent.blocks():
                    member.write(block)
