"""A dataset is a folder of episode files with a ``dataset.json``, which says what the episodes have in common."""

import os
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

from svfl_data.datasets.dataset_info import FORMAT, FORMAT_VERSION, INFO, begin, check_same, read_info
from svfl_data.datasets.held_folder import HeldFolder
from svfl_data.datasets.shards import MEMBER, member_extent, members, shard_files
from svfl_data.errors import DatasetError, FormatError, StorageError, SvflError
from svfl_data.schema.episode import Episode
from svfl_data.storage.chunks import Extent
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.leftovers import clear_files
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import refuse_link
from svfl_data.system.side_files import plain

SPLITS = "splits"
FAILURES = "failures"
"""Name of the folder inside a dataset that is a dataset of failed attempts."""
EPISODE_LIKE = re.compile(r"episode.*\.(hdf5|h5)", re.IGNORECASE)
"""Pattern of names that a person would take for those of episodes. A file is an episode only if its name is as
`Dataset.file_name` gives it."""


@dataclass(frozen=True)
class Dataset:
    """A folder of episodes that were recorded for one task with one configuration.

    Attributes:
        path: Folder of the dataset.
        info: Content of ``dataset.json``, checked: ``task``, ``seed`` and ``config``, besides ``format`` and
            ``format_version``. The optional ``varies`` lists the paths and groups in which the episodes may differ on
            purpose.

    Example:
        >>> dataset = Dataset.open("data/week")
        >>> len(dataset), [episode.meta.success for episode in dataset], len(dataset[:1])
        (2, [True, True], 1)
    """

    path: Path
    info: dict[str, Any]

    @classmethod
    def open(cls, path: Path | str) -> "Dataset":
        """Open an existing dataset.

        Args:
            path: Folder of the dataset.

        Raises:
            FormatError: If the folder or its ``dataset.json`` is missing, unreadable or of another version.
        """
        path = Path(path)
        if not path.is_dir():
            raise FormatError(f"{path}: {'is a file, not a dataset folder' if path.exists() else 'no such folder'}")
        return cls(path, read_info(path))

    @classmethod
    def create_or_resume(
        cls, path: Path | str, task: str, seed: int, config: dict[str, Any], varies: Collection[str] = ()
    ) -> "Dataset":
        """Create a dataset, or open the same dataset again to add episodes.

        Any number of processes may do so at the same moment.

        Args:
            path: Folder of the dataset. It must be absent, be empty, or hold this dataset.
            task: Name of the task of the episodes; several names with ``+`` between them, such as ``wiping+pouring``,
                if each episode is of one of them.
            seed: Seed of the dataset, which is that of all its episodes.
            config: Configuration with which the episodes are recorded (JSON values).
            varies: Paths and groups in which the episodes may differ. It is stored when the dataset is created, and
                ignored when the dataset exists.

        Returns:
            The dataset.

        Raises:
            DatasetError: If the folder holds a dataset of another task, seed or configuration, or other files.
            FieldError: If the configuration cannot be stored as JSON.
            FormatError: If the folder's ``dataset.json`` is unreadable or of another version.
            StorageError: If the folder cannot be created or written.
        """
        path = Path(path)
        asked = {"format": FORMAT, "format_version": FORMAT_VERSION, "task": task, "seed": seed, "config": config}
        info: dict[str, Any] = plain(asked, f"description of {path}")
        if not (path / INFO).exists():
            begin(path, {**info, "varies": sorted(varies)} if varies else info)
        found = cls.open(path)
        check_same(path, found.info, info)
        return found

    @property
    def varies(self) -> frozenset[str]:
        """Paths and groups in which the episodes may differ (`recording_setup`); episodes can declare more of them."""
        return frozenset(self.info.get("varies", ()))

    def episode_path(self, index: int) -> Path:
        """Return the path of the own file of an episode, whether or not this file exists.

        Args:
            index: Index of the episode.
        """
        return self.path / self.file_name(index)

    @staticmethod
    def file_name(index: int) -> str:
        """Return the name of the own file of an episode, such as ``episode_000003.hdf5``.

        Args:
            index: Index of the episode.
        """
        return f"episode_{index:06d}.hdf5"

    @property
    def indices(self) -> list[int]:
        """Indices of the episodes that exist, in files of their own or in shards, ascending.

        Every tool takes the episodes of a dataset from this list.

        Raises:
            FormatError: If a shard is damaged.
            StorageError: If the folder cannot be read.
        """
        return sorted(self.own_files().keys() | self.packed().keys())

    def own_files(self) -> dict[int, Path]:
        """Return the files of the episodes that have a file of their own, by index.

        Raises:
            StorageError: If the folder cannot be read.
        """
        return {int(match[1]): self.path / name for name in self._names() if (match := MEMBER.fullmatch(name))}

    def strays(self) -> list[str]:
        """Return the names of files that look like episodes but are not; no tool takes these files for episodes.

        Raises:
            StorageError: If the folder cannot be read.
        """
        return sorted(name for name in self._names() if EPISODE_LIKE.fullmatch(name) and not MEMBER.fullmatch(name))

    def _names(self) -> list[str]:
        try:
            return os.listdir(self.path)
        except OSError as error:
            raise StorageError(f"cannot read {self.path}: {error.strerror}") from error

    def packed(self) -> dict[int, Path]:
        """Return the shard of each episode that lies in a shard, by index.

        If an episode lies in several shards, it is the last of them. If an episode also has a file of its own, that
        file takes precedence when reading.

        Raises:
            FormatError: If a shard is damaged.
        """
        return {index: shard for shard in shard_files(self.path) for index in members(shard)}

    def extent(self, index: int) -> Extent:
        """Return the file and the byte range of an episode.

        Args:
            index: Index of the episode.

        Raises:
            DatasetError: If the dataset has no such episode.
            FormatError: If the episode's shard is damaged, or the name of its file is that of a link, folder, pipe or
                device.
        """
        file = self.episode_path(index)
        if os.path.lexists(file):
            return Extent.of_file(file)
        for shard in reversed(shard_files(self.path)):
            if index in members(shard):
                return member_extent(shard, members(shard)[index])
        indices = self.indices
        span = f"{len(indices)} episodes, {indices[0]} to {indices[-1]}" if indices else "no episodes"
        raise DatasetError(f"{self.path}: no episode {index}; it has {span}")

    def episode(self, index: int) -> EpisodeReader:
        """Return a reader of one episode, which reads arrays only when they are used.

        Args:
            index: Index of the episode.

        Raises:
            DatasetError: If the dataset has no such episode.
            FormatError: If the episode's shard is damaged. Damage of the episode itself raises an error only when it is
                read.
        """
        return EpisodeReader(self.extent(index))

    def read(self, index: int, images: bool = True) -> Episode:
        """Read one episode into memory.

        Args:
            index: Index of the episode.
            images: Whether images and the user's own arrays are read into memory, too. If False, they stay on disk
                until they are indexed (`EpisodeReader.load`).

        Raises:
            DatasetError: If the dataset has no such episode.
            FieldError: If a field of the episode does not fit its declaration.
            FormatError: If the file of the episode is damaged.
        """
        return self.episode(index).load(images)

    def __len__(self) -> int:
        return len(self.indices)

    @overload
    def __getitem__(self, place: int) -> Episode: ...

    @overload
    def __getitem__(self, place: slice) -> list[Episode]: ...

    def __getitem__(self, place: int | slice) -> Episode | list[Episode]:
        """Read the episode at a position in the order of the indices, or the episodes of a slice, as from a list.

        The indices of episodes may have gaps. `read` takes an index instead of a position, and `episode` gives a lazy
        reader.

        Args:
            place: Position or slice of positions, counted from the end if negative.

        Raises:
            IndexError: If there is no such position.
            FormatError: If a file is damaged.
        """
        if isinstance(place, slice):
            return [self.read(index) for index in self.indices[place]]
        indices = self.indices
        if not -len(indices) <= place < len(indices):
            raise IndexError(f"{self.path}: no place {place}; it has {len(indices)} episodes")
        return self.read(indices[place])

    def __iter__(self) -> Iterator[Episode]:
        return (self.read(index) for index in self.indices)

    def __repr__(self) -> str:
        indices = self.indices
        task = printable(self.info["task"], 80)
        head = f"Dataset({self.path}: {task}, {len(indices)} episodes, seed {self.info['seed']})"
        if not indices:
            return head
        try:
            return f"{head}, the first of which has\n{self.episode(indices[0]).table()}"
        except SvflError as error:
            return f"{head}; {error}"

    @contextmanager
    def writing(self) -> Iterator[HeldFolder]:
        """Lock the folder for one collector, and remove what killed collectors and killed workers left unfinished.

        The lock is released at the end of the block.

        Yields:
            The locked folder, which can tell whether it was removed or renamed meanwhile.

        Raises:
            DatasetError: If another process is collecting into the folder.
            StorageError: If the folder cannot be opened or locked.
        """
        held = HeldFolder(self.path)
        try:
            if not held.lock():
                raise DatasetError(f"{self.path}: another process is collecting into this dataset")
            self.clear()
            try:
                yield held
            finally:
                if held.in_own_process and held.in_place:
                    self.clear()
        finally:
            held.close()

    def clear(self) -> None:
        """Remove temporary files that killed processes left in the dataset; files whose writers are alive stay."""
        clear_files(self.path)
        if not (self.path / SPLITS).is_symlink():
            clear_files(self.path / SPLITS)


def open_dataset(path: Path | str) -> Dataset:
    """Open a folder of episodes as a dataset; this is the same as `Dataset.open`.

    Args:
        path: Folder of the dataset.

    Returns:
        The dataset.

    Raises:
        FormatError: If the folder is not a dataset, or is one of another version.

    Example:
        >>> dataset = open_dataset("data/week")
        >>> len(dataset), dataset[0].meta.task
        (2, 'centering')
    """
    return Dataset.open(path)


def inner_folder(folder: Path, name: str) -> Path:
    """Return a folder inside the folder of a dataset, creating it if needed.

    Args:
        folder: Folder of the dataset.
        name: Name of the inner folder.

    Raises:
        FormatError: If the inner folder is a link or a file.
        StorageError: If the disk refuses to create the inner folder.
    """
    path = folder / name
    refuse_link(path)
    try:
        path.mkdir(exist_ok=True)
    except FileExistsError as error:
        raise FormatError(f"{path}: not a folder") from error
    except OSError as error:
        raise StorageError(f"cannot create {path}: {error.strerror}") from error
    return path
