"""A new dataset from one of version 1 of the episode format: the same content in files of the present version."""

import os
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from itertools import chain, groupby
from pathlib import Path

from svfl_data.datasets.dataset import FAILURES, Dataset
from svfl_data.datasets.dataset_info import INFO, begin
from svfl_data.datasets.shards import member_extent, members, shard_files
from svfl_data.errors import DatasetError, OldVersionError, StorageError
from svfl_data.maintenance.merge import check_free
from svfl_data.maintenance.pack import member_info
from svfl_data.maintenance.upgrade_side_files import copy_journals, copy_splits, others
from svfl_data.maintenance.version_1 import read_version_1
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import FORMAT_VERSION, header
from svfl_data.storage.store import episode_bytes
from svfl_data.system.atomic_io import write_atomically, written_aside
from svfl_data.system.leftovers import clear_folders, folder_aside
from svfl_data.system.progress import progress
from svfl_data.system.regular_file import refuse_link


@dataclass
class Upgraded:
    """What was done to make the new dataset.

    Attributes:
        episodes: Number of episodes in the new dataset, failed attempts included.
        current: Number of those that were in the present version already, and were copied as they are.
        left_out: Number of episodes in which an array was left out that no reader of version 1 knew, by dataset path.
        journals: Number of unfinished recordings that were copied.
        others: Names of the files and folders that do not belong to a dataset, and were not copied.
    """

    episodes: int = 0
    current: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    journals: int = 0
    others: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Place:
    """An episode, and the file of the new dataset in which it will lie: its own file, or a shard."""

    index: int
    extent: Extent
    file: Path


def upgrade(source: Dataset, destination: Path) -> Upgraded:
    """Make a new dataset of the present version from a dataset of version 1; the old one is not changed.

    Episodes keep their numbers, metadata and places in shards, and their history states the seal that they had before.
    Splits keep their episodes, and stored statistics stay valid. The same dataset always gives the same bytes.

    Args:
        source: Dataset to upgrade.
        destination: Folder of the new dataset, which must be absent or empty, and not inside the old one.

    Returns:
        What was done.

    Raises:
        DatasetError: If the destination is taken or inside the source, or no episode is of version 1.
        FormatError: If an episode or shard is damaged.
        FieldError: If an episode is not valid.
        StorageError: If the disk refuses; no part of the destination remains.
    """
    check_free(destination)
    if destination.resolve().is_relative_to(source.path.resolve()):
        raise DatasetError(f"{destination} is inside {source.path}, which must not be changed; name another folder")
    parts = _parts(source)
    _check_old(source, parts.values())
    made = Upgraded(others=others(source))
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        clear_folders(destination.parent)
        with folder_aside(destination) as aside:
            aside.chmod(0o755)
            for name, part in parts.items():
                begin(aside / name, part.info)
            places = [place for name, part in parts.items() for place in _places(part, aside / name)]
            _write(places, made)
            for name, part in parts.items():
                new = Dataset.open(aside / name)
                copy_splits(part, new)
                made.journals += copy_journals(part, new)
            os.replace(aside, destination)
    except OSError as error:
        raise StorageError(f"cannot create {destination}: {error.strerror}") from error
    return made


def _parts(source: Dataset) -> dict[str, Dataset]:
    """Return the dataset and that of its failed attempts, if there is one, by the name of the folder inside it."""
    failures = source.path / FAILURES
    refuse_link(failures)
    return {"": source, FAILURES: Dataset.open(failures)} if (failures / INFO).exists() else {"": source}


def _check_old(source: Dataset, parts: Iterable[Dataset]) -> None:
    """Check that some episode is of version 1, which is quick if the first one is."""
    count = 0
    for part in parts:
        for place in _places(part, part.path):
            try:
                header(place.extent)
            except OldVersionError:
                return
            count += 1
    found = f"its {count} episodes are in format {FORMAT_VERSION} already" if count else "the dataset has no episodes"
    raise DatasetError(f"{source.path}: {found}; there is nothing to upgrade")


def _places(part: Dataset, folder: Path) -> Iterator[_Place]:
    """Yield every episode of a dataset, also one in a shard in whose place a file of its own is read."""
    for index, file in sorted(part.own_files().items()):
        yield _Place(index, Extent.of_file(file), folder / file.name)
    for shard in shard_files(part.path):
        for index, member in members(shard).items():
            yield _Place(index, member_extent(shard, member), folder / shard.name)


def _write(places: Sequence[_Place], made: Upgraded) -> None:
    """Write the files of the new dataset, one episode in memory at a time."""
    for file, group in groupby(progress(places, "upgrading episodes"), key=lambda place: place.file):
        first = next(group)
        if not first.extent.member:
            write_atomically(file, _upgraded(first.extent, made))
            continue
        with written_aside(file) as whole, zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archive:
            for place in chain([first], group):
                content = _upgraded(place.extent, made)
                archive.writestr(member_info(place.index, len(content)), content)


def _upgraded(extent: Extent, made: Upgraded) -> bytes:
    """Return the content of the new file of an episode."""
    old = read_version_1(extent)
    made.episodes += 1
    if old is None:
        header(extent, hashed=True)
        made.current += 1
        return b"".join(extent.blocks())
    made.left_out.update(old.left_out)
    tool = {"tool": "svfl-data upgrade", "version": version("svfl")}
    entry = {**tool, "from_version": old.version, "seal": old.seal, "left_out": list(old.left_out)}
    meta = replace(old.episode.meta, history=[*old.episode.meta.history, entry])
    return episode_bytes(replace(old.episode, meta=meta))
