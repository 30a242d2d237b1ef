"""A dataset: a folder of episode files plus ``dataset.json``, which says what they have in common."""

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svfl_data.atomically import write_atomically
from svfl_data.chunks import Extent
from svfl_data.episode import Episode
from svfl_data.errors import DatasetError, FormatError, StorageError, SvflError
from svfl_data.held_folder import HeldFolder
from svfl_data.reader import EpisodeReader
from svfl_data.shards import MEMBER, member_extent, members, shard_files
from svfl_data.store import read_episode

FORMAT = "svfl-dataset"
FORMAT_VERSION = "1.0"
INFO = "dataset.json"
BEGINNING = re.compile(rf"\.{re.escape(INFO)}\..*\.part")
"""Name under which `write_atomically` writes ``dataset.json`` aside."""


@dataclass(frozen=True)
class Dataset:
    """A folder of episodes that were recorded for one task with one configuration.

    Attributes:
        path: The folder.
        info: Content of ``dataset.json``: ``task``, ``seed`` and ``config``, beside format and version.
    """

    path: Path
    info: dict[str, Any]

    @classmethod
    def open(cls, path: Path | str) -> "Dataset":
        """Open an existing dataset.

        Raises:
            FormatError: If the folder or its ``dataset.json`` is missing, unreadable or of another version.
        """
        path = Path(path)
        if not path.is_dir():
            raise FormatError(f"{path}: {'is a file, not a dataset folder' if path.exists() else 'no such folder'}")
        try:
            info = json.loads((path / INFO).read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise FormatError(f"{path}: not a dataset (it has no {INFO})") from error
        except (OSError, ValueError) as error:
            raise FormatError(f"{path / INFO}: not readable as JSON ({error})") from error
        if not isinstance(info, dict) or info.get("format") != FORMAT:
            raise FormatError(f"{path / INFO}: does not describe a dataset (format is not {FORMAT!r})")
        if str(info.get("format_version")).split(".")[0] != FORMAT_VERSION.split(".")[0]:
            found, ours = info.get("format_version"), FORMAT_VERSION.split(".")[0]
            raise FormatError(f"{path / INFO}: format version {found}; this software reads {ours}.x")
        return cls(path, info)

    @classmethod
    def create_or_resume(cls, path: Path | str, task: str, seed: int, config: dict[str, Any]) -> "Dataset":
        """Start a dataset, or take up the same one again; any number of processes may do so at the same moment.

        Raises:
            DatasetError: If the folder holds a dataset of another task, seed or configuration, or other files.
            StorageError: If the folder cannot be created or written.
        """
        path = Path(path)
        info = {"format": FORMAT, "format_version": FORMAT_VERSION, "task": task, "seed": seed, "config": config}
        if not (path / INFO).exists():
            _begin(path, info)
        found = cls.open(path)
        _check_same(path, found.info, json.loads(json.dumps(info)))
        return found

    def episode_path(self, index: int) -> Path:
        """File of an episode, whether or not it exists."""
        return self.path / self.file_name(index)

    @staticmethod
    def file_name(index: int) -> str:
        """Name of an episode's file."""
        return f"episode_{index:06d}.hdf5"

    @property
    def indices(self) -> list[int]:
        """Indices of the episodes that exist, in files of their own or in shards, ascending."""
        return sorted(self.own_files().keys() | self.packed().keys())

    def own_files(self) -> dict[int, Path]:
        """The episodes in files of their own, by index."""
        return {
            int(match[1]): Path(entry.path)
            for entry in os.scandir(self.path)
            if (match := MEMBER.fullmatch(entry.name))
        }

    def packed(self) -> dict[int, Path]:
        """The shard of each episode that lies in one; a file of its own comes before it when reading.

        Raises:
            FormatError: If a shard is damaged.
        """
        return {index: shard for shard in shard_files(self.path) for index in members(shard)}

    def extent(self, index: int) -> Extent:
        """Where the bytes of an episode lie.

        Raises:
            DatasetError: If the dataset has no such episode.
            FormatError: If its shard is damaged.
        """
        file = self.episode_path(index)
        if file.exists():
            return Extent.of_file(file)
        for shard in reversed(shard_files(self.path)):
            if index in members(shard):
                return member_extent(shard, members(shard)[index])
        indices = self.indices
        span = f"{len(indices)} episodes, {indices[0]} to {indices[-1]}" if indices else "no episodes"
        raise DatasetError(f"{self.path}: no episode {index}; it has {span}")

    def episode(self, index: int) -> EpisodeReader:
        """One episode to read lazily.

        Raises:
            DatasetError: If the dataset has no such episode.
            FormatError: If its shard is damaged; damage of the episode itself shows when it is read.
        """
        return EpisodeReader(self.extent(index))

    def read(self, index: int) -> Episode:
        """Read one episode.

        Raises:
            DatasetError: If the dataset has no such episode.
            FormatError: If its file is damaged.
        """
        reader = self.episode(index)
        return reader.load() if reader.extent.member else read_episode(reader.extent.file)

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[Episode]:
        return (self.read(index) for index in self.indices)

    def __repr__(self) -> str:
        indices = self.indices
        head = f"Dataset({self.path}: {self.info['task']}, {len(indices)} episodes, seed {self.info['seed']})"
        if not indices:
            return head
        try:
            return f"{head}, the first of which has\n{self.episode(indices[0]).table()}"
        except SvflError as error:
            return f"{head}; {error}"

    @contextmanager
    def writing(self) -> Iterator[HeldFolder]:
        """Hold the folder for one collector, and clear away what killed ones and killed workers were writing.

        Yields:
            The folder, which can tell whether it was removed or renamed meanwhile.

        Raises:
            DatasetError: If another process is collecting into the folder.
            StorageError: If the folder cannot be opened or locked.
        """
        held = HeldFolder(self.path)
        try:
            if not held.lock():
                raise DatasetError(f"{self.path}: another process is collecting into this dataset")
            self._clear()
            try:
                yield held
            finally:
                if held.in_own_process and held.in_place:
                    self._clear()
        finally:
            held.close()

    def _clear(self) -> None:
        for leftover in self.path.glob(".*.part"):
            leftover.unlink(missing_ok=True)


def _begin(path: Path, info: dict[str, Any]) -> None:
    """Put ``dataset.json`` into an absent or empty folder, unless another process does so at the same moment.

    Whoever puts anything else into a dataset's folder has seen its ``dataset.json``, which never goes again. So files
    that another process has brought meanwhile are told from foreign ones by looking for it after them; before it there
    is nothing but what others, or killed ones, were writing it to.
    """
    empty = not path.exists() or (path.is_dir() and all(BEGINNING.fullmatch(name) for name in os.listdir(path)))
    if not empty and not (path / INFO).exists():
        raise DatasetError(f"{path} holds other files and no {INFO}; name a new or empty folder")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"cannot create {path}: {error.strerror}") from error
    try:
        write_atomically(path / INFO, (json.dumps(info, indent=2, sort_keys=True) + "\n").encode(), replace=False)
    except StorageError:
        if not (path / INFO).exists():
            raise  # else another process was first, and may have cleared away what was written here


def _check_same(path: Path, found: dict[str, Any], asked: dict[str, Any]) -> None:
    here, wanted = _flat({key: found.get(key) for key in asked}), _flat(asked)
    for key in wanted | here:  # what only one of them has is a difference, too
        if here.get(key) != wanted.get(key):
            raise DatasetError(
                f"{path} holds another dataset: its {key} is {here.get(key)!r}, asked for {wanted.get(key)!r}; "
                "name another folder"
            )


def _flat(value: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, item in value.items():
        flat |= _flat(item, f"{prefix}{key}.") if isinstance(item, dict) else {f"{prefix}{key}": item}
    return flat
