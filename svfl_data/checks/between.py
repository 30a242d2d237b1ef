"""Checks between the episodes of a dataset: different setups, copies, and names or numbers that do not fit."""

from collections.abc import Iterator
from pathlib import Path

from svfl_data.checks.finding import Finding
from svfl_data.checks.placing import check_place
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.duplicates import content_id, copies
from svfl_data.datasets.recording_setup import Common, Setup
from svfl_data.datasets.shards import members, shard_files
from svfl_data.schema.episode import Episode
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.printable import printable

NAMED = 5
"""Largest number of names that one finding lists."""


class Between:
    """Comparison of the episodes of a dataset, which are added one after the other.

    Args:
        dataset: Dataset to which the episodes belong.
    """

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self._setups: list[tuple[str, Setup]] = []
        self._contents: list[tuple[str, str]] = []
        self._first: Episode | None = None
        self._found: list[Finding] = []

    def add(self, index: int, reader: EpisodeReader, episode: Episode) -> None:
        """Add an episode that could be read.

        Args:
            index: Index of the episode in the dataset.
            reader: Reader of the episode.
            episode: The episode itself; its images need not be in memory.
        """
        arrays = {path: reader[path] for path in reader.paths}
        self._setups.append((episode.name, Setup.of(episode.meta, arrays, episode.declarations)))
        self._contents.append((episode.name, content_id(reader)))
        self._first = self._first or episode
        self._found += [*check_place(self._dataset, index), *self._lacking(self._first, episode)]

    def findings(self) -> list[Finding]:
        """Return everything that does not fit together among the episodes added so far."""
        return [*self._found, *self._unlike(), *self._copies(), *self._named()]

    def _lacking(self, first: Episode, episode: Episode) -> Iterator[Finding]:
        """Find arrays that only one of two episodes has, other than those of cameras, which the setup compares."""
        for path in sorted(first.arrays.keys() ^ episode.arrays.keys()):
            if not path.startswith("cameras/"):
                words = f"{'missing' if path in first.arrays else 'extra'}, compared with {Path(first.name).name}"
                yield Finding(episode.name, path, None, "warning", words)

    def _unlike(self) -> Iterator[Finding]:
        varies = {path for _, setup in self._setups for path in setup.varies}
        common = Common(self._dataset.varies | varies)
        for name, setup in self._setups:
            for found in common.differences(setup):
                words = f"is {found.here}, but {found.there} in {Path(found.where).name}"
                yield Finding(name, found.name, None, "error", words)
            common.add(setup, name)

    def _copies(self) -> Iterator[Finding]:
        for copy, first in copies(self._contents):
            words = f"the same recording as {Path(first).name}; a split could train on one and test on the other"
            yield Finding(copy, "", None, "error", words)

    def _named(self) -> Iterator[Finding]:
        """Find files that look like episodes but are none, and episodes that lie in several shards."""
        name = str(self._dataset.path)
        if strays := self._dataset.strays():
            words = "not counted as episodes, which are named like episode_000012.hdf5: "
            yield Finding(name, "", None, "warning", words + _some(strays))
        shards: dict[int, list[str]] = {}
        for shard in shard_files(self._dataset.path):
            for index in members(shard):
                shards.setdefault(index, []).append(shard.name)
        several = [f"{index} ({', '.join(names)})" for index, names in sorted(shards.items()) if len(names) > 1]
        if several:
            words = "in more than one shard, of which the last is read unless there is a file of its own: episodes "
            yield Finding(name, "", None, "warning", words + _some(several))


def _some(names: list[str]) -> str:
    return ", ".join(printable(name, 80) for name in names[:NAMED]) + (
        f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    )
