"""What a worker does, wherever it runs, and what happens when one dies."""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from collectors.recording.loop import Watcher, unwatched
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.held_folder import Identity, check_same
from svfl_data.errors import CollectError
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import write_episode


def forget(episode: Episode) -> None:
    """What is done with a failed attempt by default: nothing."""


class Collector(Protocol):
    """Produces episodes; an episode depends on nothing but its index and what the collector was made with."""

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Collect the episode of an index.

        Args:
            index: Index of the episode.
            keep: Is given every failed attempt, if the collector makes episodes of those.
            watch: Is told of every observation and action of every attempt.

        Raises:
            CollectError: If no attempt succeeds.
        """


FAILURES = "failures"
"""Folder of the dataset of failed attempts, inside that of the demonstrations."""
DEATHS = 3
"""Workers that may die one after the other; the last one ends the collection."""


@dataclass(frozen=True)
class Collected:
    """What a worker reports of one finished episode.

    Attributes:
        index: Of the episode.
        steps: Its length.
        success: Whether the task was achieved.
        attempts: How many attempts it took.
        files: What was written, relative to the dataset's folder.
    """

    index: int
    steps: int
    success: bool
    attempts: int
    files: tuple[str, ...]


@dataclass(frozen=True)
class Worker:
    """Makes episodes and writes them.

    Attributes:
        collector: Makes the episodes.
        folder: Of the dataset, on the worker's machine.
        task: What `Dataset.create_or_resume` needs to begin the folder where the machine does not have it yet.
        seed: The same.
        config: The same.
        keep_failures: Whether to write failed attempts into a dataset of their own.
        identity: Which folder it is; with it, one that was removed or renamed is never made again.
    """

    collector: Collector
    folder: Path
    task: str
    seed: int
    config: dict
    keep_failures: bool = False
    identity: Identity | None = None

    def dataset(self, name: str = "") -> Dataset:
        """The dataset in the folder, or in one inside it.

        Raises:
            StorageError: If the folder is not the one that it was.
        """
        if self.identity is not None:
            check_same(self.folder, self.identity)
        return Dataset.create_or_resume(self.folder / name, self.task, self.seed, self.config)

    def collect(self, index: int) -> Collected:
        """Make and write the episode of an index."""
        self.dataset()  # before anything else is in the folder
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
    """Has workers collect."""

    def __call__(self, indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
        """Collect the episodes of some indices.

        Args:
            indices: Which.
            workers: How many at a time.
            worker: Is sent to where it works.

        Yields:
            What is finished and on disk, by completion.

        Raises:
            CollectError: If workers keep dying.
            SvflError: Whatever a collector raises.
        """


class Deaths:
    """Counts workers that died since an episode was finished."""

    def __init__(self) -> None:
        self._count = 0

    def forget(self) -> None:
        """An episode was finished."""
        self._count = 0

    def count(self, who: str, indices: Sequence[int]) -> None:
        """Say that a worker died and what is redone.

        Raises:
            CollectError: If too many have died in a row.
        """
        self._count += 1
        numbers = f"episode{'s' if len(indices) > 1 else ''} {', '.join(map(str, sorted(indices)))}"
        if self._count == DEATHS:
            raise CollectError(
                f"{who} died {DEATHS} times in a row (killed, or out of memory), at last with {numbers}; what was "
                "finished is on disk, and the same command resumes"
            )
        print(f"{who} died; {numbers} will be redone", file=sys.stderr, flush=True)
