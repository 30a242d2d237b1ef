"""New datasets from old ones: chosen episodes are copied whole, and the history of each copy states its origin."""

import dataclasses
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from svfl_data.checks import sound
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.duplicates import copies, copies_words
from svfl_data.datasets.index import Entry, entries
from svfl_data.datasets.recording_setup import Common, first_difference, refuse_difference
from svfl_data.errors import DatasetError, StorageError
from svfl_data.maintenance.relabel import history_entry
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import write_episode
from svfl_data.system.leftovers import clear_folders, folder_aside
from svfl_data.system.progress import progress

RATE_TOLERANCE = 0.05  # share by which rates may differ; mean rates of short episodes vary by up to one reading


@dataclass(frozen=True)
class Chosen:
    """An episode that is chosen for the new dataset.

    Attributes:
        source: Dataset that holds the episode.
        entry: Entry of the episode in the index of that dataset.
    """

    source: Dataset
    entry: Entry

    def __str__(self) -> str:
        return str(self.source.path / self.entry.name)


def merge(
    sources: Sequence[Dataset], destination: Path, varies: Collection[str] = (), once: bool = False
) -> tuple[int, int]:
    """Put the episodes of several datasets into a new one, numbered from 0.

    Args:
        sources: Datasets to copy the episodes from, in this order.
        destination: Folder of the new dataset, which must be absent or empty.
        varies: Dataset paths and groups in which the episodes may differ, in addition to those that the sources name.
        once: Whether to take only the first of several copies of one recording. If False, copies are an error.

    Returns:
        Number of episodes in the new dataset, and number of copies that were left out.

    Raises:
        DatasetError: If the destination is taken, a source has no episodes, an episode is damaged, two episodes differ
            in their setup or are copies, or the streams or rates of two datasets differ.
        StorageError: If the disk refuses; no part of the destination remains.

    Example:
        >>> from pathlib import Path
        >>> merge([dataset], Path("data/merged"))
        (2, 0)
    """
    check_free(destination)
    chosen = [Chosen(source, entry) for source in sources for entry in readable(source)]
    return copy(chosen, destination, "merge", {}, varies, once)


def choose(
    source: Dataset,
    destination: Path,
    keep: Callable[[Episode], bool],
    conditions: list[str],
    varies: Collection[str] = (),
    once: bool = False,
    valid: bool = False,
) -> tuple[int, int]:
    """Put the episodes of a dataset that meet some conditions into a new dataset, numbered from 0.

    Args:
        source: Dataset to copy the episodes from.
        destination: Folder of the new dataset, which must be absent or empty.
        keep: Function that returns whether to keep an episode.
        conditions: The conditions of `keep` in words. They are stored in the configuration of the new dataset.
        varies: Dataset paths and groups in which the episodes may differ, in addition to those that the source names.
        once: Whether to take only the first of several copies of one recording. If False, copies are an error.
        valid: Whether to leave out episodes in which ``svfl-data validate`` finds an error, and episodes that cannot be
            read.

    Returns:
        Number of episodes in the new dataset, and number of copies that were left out.

    Raises:
        DatasetError: If the destination is taken, an episode is damaged (unless `valid`), no episode meets the
            conditions, or two that meet them differ in their setup or are copies.
        StorageError: If the disk refuses; no part of the destination remains.
    """
    check_free(destination)
    found = _sound(source) if valid else readable(source)
    chosen = [Chosen(source, entry) for entry in progress(found, "choosing episodes") if keep(source.read(entry.index))]
    if not chosen:
        raise DatasetError(
            f"{source.path}: no episode meets {', '.join(conditions)}; of {len(found)} episodes {_have(found)}"
        )
    return copy(chosen, destination, "filter", {"conditions": conditions}, varies, once)


def _sound(source: Dataset) -> list[Entry]:
    """Return the index of a dataset without the episodes in which ``svfl-data validate`` finds an error."""
    wanted = set(sound(source))
    return [entry for entry in entries(source) if entry.index in wanted]


def _have(found: Sequence[Entry]) -> str:
    """Describe success, sources and tasks of some episodes, for which filter conditions usually ask."""
    successes = sum(entry.success for entry in found)
    sources, tasks = (sorted({getattr(entry, key) for entry in found}) for key in ("source", "task"))
    return f"{successes} have success=true, sources are {', '.join(sources)}, tasks {', '.join(tasks)}"


def copy(
    chosen: Sequence[Chosen],
    destination: Path,
    command: str,
    facts: dict[str, Any],
    varies: Collection[str] = (),
    once: bool = False,
) -> tuple[int, int]:
    """Copy episodes into a new dataset, which gets its name only when it is whole; used by `merge` and `choose`.

    Args:
        chosen: Episodes to copy, in the order in which they are numbered.
        destination: Folder of the new dataset, which must be absent or empty.
        command: Command of ``svfl-data`` that makes the copy, such as ``merge``.
        facts: Facts about the copy to store in the configuration of the new dataset (JSON values).
        varies: Dataset paths and groups in which the episodes may differ, in addition to those that the sources name.
        once: Whether to take only the first of several copies of one recording. If False, copies are an error.

    Returns:
        Number of episodes in the new dataset, and number of copies that were left out.

    Raises:
        DatasetError: If the destination is taken, two episodes differ in their setup or are copies, or the streams or
            rates of two datasets differ.
        StorageError: If the disk refuses; no part of the destination remains.
    """
    check_free(destination)
    sources = list({one.source.path: one.source for one in chosen}.values())
    kept = _without_copies(chosen, once)
    may_vary = {*varies, *(path for source in sources for path in source.varies)}
    refuse_difference(
        first_difference([(str(one), one.entry.setup) for one in kept], Common(may_vary)),
        f"{command} these episodes",
        "if it differs on purpose, allow it with --varies {name}",
    )
    _check_rates(kept, may_vary)
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        clear_folders(destination.parent)
        with folder_aside(destination) as aside:
            aside.chmod(0o755)
            tasks = sorted({task for source in sources for task in str(source.info["task"]).split("+")})
            config = {"made_by": f"svfl-data {command}", **facts, "sources": [_origin(source) for source in sources]}
            seed = int(sources[0].info["seed"])
            new = Dataset.create_or_resume(aside, "+".join(tasks), seed, config, may_vary)
            for number, one in enumerate(progress(kept, "copying episodes")):
                episode = one.source.read(one.entry.index, images=False)
                write_episode(_moved(episode, one.source, number, command), new.episode_path(number))
            os.replace(aside, destination)
    except OSError as error:
        raise StorageError(f"cannot create {destination}: {error.strerror}") from error
    return len(kept), len(chosen) - len(kept)


def _without_copies(chosen: Sequence[Chosen], once: bool) -> list[Chosen]:
    found = copies((position, one.entry.content) for position, one in enumerate(chosen))
    if found and not once:
        words = copies_words([(chosen[copy], chosen[first]) for copy, first in found])
        raise DatasetError(
            f"the same recording more than once: {words}; in a split one could be trained and the other tested on; "
            "--once takes the first of each"
        )
    left_out = {copy for copy, _ in found}
    return [one for position, one in enumerate(chosen) if position not in left_out]


def check_free(destination: Path) -> None:
    """Check that a folder can become a new dataset.

    Raises:
        DatasetError: If the folder is not empty, or there is a file of its name.
        StorageError: If the folder cannot be read.
    """
    try:
        if os.path.lexists(destination) and (not destination.is_dir() or any(destination.iterdir())):
            raise DatasetError(f"{destination} exists and is not empty; name a new folder")
    except OSError as error:
        raise StorageError(f"cannot read {destination}: {error.strerror}") from error


def _origin(source: Dataset) -> dict[str, Any]:
    return {"dataset": _name(source), **{key: source.info.get(key) for key in ("task", "seed", "config")}}


def _moved(episode: Episode, source: Dataset, number: int, command: str) -> Episode:
    came_from = {"dataset": _name(source), "index": episode.meta.index, "seed": episode.meta.seed}
    history = [*episode.meta.history, history_entry(command, came_from=came_from)]
    return dataclasses.replace(episode, meta=dataclasses.replace(episode.meta, index=number, history=history))


def _name(dataset: Dataset) -> str:
    """Return the name of a dataset's folder, without its path on this machine, which must stay private."""
    return dataset.path.resolve().name


def readable(dataset: Dataset) -> list[Entry]:
    """Return the index of a dataset after checking that all of its episodes can be read.

    Raises:
        DatasetError: If an episode is damaged, or the dataset has no episodes.
    """
    found = entries(dataset)
    for entry in found:
        if entry.error:
            raise DatasetError(f"{entry.error}; see svfl-data validate and svfl-data repair")
    if not found:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    return found


def _check_rates(chosen: Sequence[Chosen], varies: Collection[str]) -> None:
    """Check that the episodes of several datasets have the same streams and about the same rates.

    Setups do not compare these facts.

    Raises:
        DatasetError: If streams or rates differ.
    """
    sources = {one.source.path: [other.entry for other in chosen if other.source is one.source] for one in chosen}
    first, *others = [(path, dict(_rates(found))) for path, found in sources.items()]
    for path, rates in others:
        for name in sorted((first[1].keys() | rates.keys()) - set(varies)):
            here, there = rates.get(name), first[1].get(name)
            if not _same(here, there):
                raise DatasetError(
                    f"cannot merge: rate of {name} is {_words(there)} in {first[0]}, but {_words(here)} in {path}; "
                    f"if it differs on purpose, allow it with --varies {name}"
                )


def _rates(found: Sequence[Entry]) -> Iterator[tuple[str, float]]:
    """Yield each stream and camera of some episodes with its median rate, [Hz]; 0 if no episode has two readings."""
    for kind in ("cameras", "streams"):
        measured: dict[str, list[float]] = {}
        for entry in found:
            for name, (_, rate, *_size) in getattr(entry, kind).items():
                measured.setdefault(name, []).extend([] if rate is None else [rate])
        yield from ((f"{kind}/{name}", float(median(rates or [0.0]))) for name, rates in measured.items())


def _same(here: float | None, there: float | None) -> bool:
    if here is None or there is None:
        return here == there
    return abs(here - there) <= RATE_TOLERANCE * max(here, there) or 0.0 in (here, there)


def _words(rate: float | None) -> str:
    return "missing" if rate is None else f"{rate:.1f} Hz"
