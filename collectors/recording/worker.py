"""Worker that makes and writes episodes, wherever it runs, and the count of workers that died."""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from collectors.recording.loop import unwatched
from svfl_data.datasets.dataset import FAILURES as FAILURES  # imported for users of this module
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.held_folder import Identity, check_same
from svfl_data.errors import CollectError, FormatError
from svfl_data.schema.episode import Episode
from svfl_data.schema.robot import Watcher
from svfl_data.storage.store import write_episode


def forget(episode: Episode) -> None:
    """Do nothing with a failed attempt, which is the default."""


class Collector(Protocol):
    """Object that makes the episode of an index; the result depends only on the index and the object's own settings."""

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Collect the episode of an index.

        Args:
            index: Index of the episode.
            keep: Function that is called with every failed attempt, if the collector makes episodes of those.
            watch: Function that is called with every observation and action of every attempt.

        Raises:
            CollectError: If no attempt succeeds.
        """


DEATHS = 3
"""Number of workers that die in a row, without a finished episode between them, at which the collection ends."""


@dataclass(frozen=True)
class Collected:
    """Report of a worker about one finished episode.

    Attributes:
        index: Index of the episode.
        steps: Number of steps of the episode.
        success: Whether the task was achieved.
        attempts: Number of attempts that the episode took.
        files: Paths of the files that were written, relative to the dataset's folder.
    """

    index: int
    steps: int
    success: bool
    attempts: int
    files: tuple[str, ...]


@dataclass(frozen=True)
class Worker:
    """Worker that makes episodes and writes them into a dataset.

    Attributes:
        collector: Collector that makes the episodes.
        folder: Folder of the dataset on the worker's machine.
        task: Name of the task, with which `Dataset.create_or_resume` creates the dataset if the machine does not have
            it yet.
        seed: Seed of the dataset, for the same purpose.
        config: Configuration of the dataset, for the same purpose.
        keep_failures: Whether to write failed attempts into a dataset of their own.
        identity: Identity of the folder, so that a folder that was removed or renamed is never created again. None
            skips this check.
    """

    collector: Collector
    folder: Path
    task: str
    seed: int
    config: dict
    keep_failures: bool = False
    identity: Identity | None = None

    def dataset(self, name: str = "") -> Dataset:
        """Return the dataset in the worker's folder, which is created if it does not exist.

        Args:
            name: Name of a folder inside the worker's folder. By default the dataset is the one in the worker's folder
                itself.

        Raises:
            StorageError: If the folder is no longer the one that the worker was made for.
        """
        if self.identity is None:
            return Dataset.create_or_resume(self.folder / name, self.task, self.seed, self.config)
        check_same(self.folder, self.identity)
        try:
            return Dataset.open(self.folder / name)  # never made here, where it may be gone since the check
        except FormatError:
            check_same(self.folder, self.identity)
            raise

    def collect(self, index: int) -> Collected:
        """Make and write the episode of an index, and return the report of it."""
        self.dataset()  # created before anything else is in the folder
        files: list[str] = []

        def write(episode: Episode, name: str = "") -> None:
            path = self.dataset(name).episode_path(episode.meta.index)
            write_episode(episode, path)
            files.append(str(path.relative_to(self.folder)))

        keep = (lambda failed: write(failed, FAILURES)) if self.keep_failures else forget
        episode = self.collector(index, keep=keep)
        write(episode)
        attempts = 1 + len(episode.meta.config["rejected"])
        return Collected(index, len(episode), episode.meta.success, attempts, tuple(files))


class Executor(Protocol):
    """Function that collects episodes with several workers."""

    def __call__(self, indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
        """Collect the episodes of some indices.

        Args:
            indices: Indices of the episodes to collect.
            workers: Number of workers that run at a time.
            worker: Worker to run, which is sent to the process that runs it.

        Yields:
            The report of each episode that is finished and on disk, in order of completion.

        Raises:
            CollectError: If workers keep dying.
            SvflError: If a collector raises one, which is passed on.
        """


class Deaths:
    """Counter of the workers that died since an episode was last finished."""

    def __init__(self) -> None:
        self._count = 0

    def forget(self) -> None:
        """Reset the count, since an episode was finished."""
        self._count = 0

    def count(self, who: str, indices: Sequence[int]) -> None:
        """Count a worker that died, and print which episodes are collected again.

        Args:
            who: Kind of the worker, for the message.
            indices: Indices of the episodes that the worker did not finish.

        Raises:
            CollectError: If `DEATHS` workers have died in a row.
        """
        self._count += 1
        numbers = f"episode{'s' if len(indices) > 1 else ''} {', '.join(map(str, sorted(indices)))}"
        if self._count == DEATHS:
            raise CollectError(
                f"{who} died {DEATHS} times in a row (killed, or out of memory), at last with {numbers}; what was "
                "finished is on disk, and the same command resumes"
            )
        print(f"{who} died; {numbers} will be redone", file=sys.stderr, flush=True)
