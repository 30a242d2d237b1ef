"""New datasets from old ones: chosen episodes, copied whole, each with where it came from in its history."""

import dataclasses
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from svfl_data.checks import sound
from svfl_data.dataset import Dataset
from svfl_data.episode import Episode
from svfl_data.errors import DatasetError, StorageError
from svfl_data.index import Entry, entries
from svfl_data.progress import progress
from svfl_data.relabel import history_entry
from svfl_data.store import write_episode

RATE_TOLERANCE = 0.05  # mean rates of short episodes differ by up to a reading


def merge(sources: Sequence[Dataset], destination: Path) -> int:
    """Put the episodes of several datasets into a new one, numbered from 0.

    Args:
        sources: Where from, in this order.
        destination: A folder that does not exist yet, or is empty.

    Returns:
        Number of episodes.

    Raises:
        DatasetError: If the destination is taken, an episode is damaged, or cameras, streams or rates differ.
        StorageError: If the disk refuses; no part of the destination remains.
    """
    check_compatible(sources)
    chosen = [(source, entry.index) for source in sources for entry in readable(source)]
    return copy(chosen, destination, "merge", {})


def choose(
    source: Dataset, destination: Path, keep: Callable[[Episode], bool], conditions: list[str], valid: bool = False
) -> int:
    """Put the episodes that meet conditions into a new dataset, numbered from 0.

    Args:
        source: Where from.
        destination: A folder that does not exist yet, or is empty.
        keep: Whether to keep an episode.
        conditions: The same in words, for the record.
        valid: Leave out what ``svfl-data validate`` calls an error, episodes that cannot be read among them.

    Returns:
        Number of episodes.

    Raises:
        DatasetError: If the destination is taken, an episode is damaged, or none meets the conditions.
        StorageError: If the disk refuses; no part of the destination remains.
    """
    indices = sound(source) if valid else [entry.index for entry in readable(source)]
    chosen = [(source, index) for index in progress(indices, "choosing episodes") if keep(source.read(index))]
    if not chosen:
        raise DatasetError(f"{source.path}: no episode meets {', '.join(conditions)}")
    return copy(chosen, destination, "filter", {"conditions": conditions})


def copy(chosen: Sequence[tuple[Dataset, int]], destination: Path, verb: str, facts: dict[str, Any]) -> int:
    """Copy episodes into a new dataset, which appears when it is whole; see `merge` and `choose`."""
    if destination.exists() and (not destination.is_dir() or any(destination.iterdir())):
        raise DatasetError(f"{destination} exists and is not empty; name a new folder")
    sources = list({source.path: source for source, _ in chosen}.values())
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(dir=destination.parent, prefix=f".{destination.name}.", suffix=".part"))
    except OSError as error:
        raise StorageError(f"cannot create {destination}: {error.strerror}") from error
    try:
        aside.chmod(0o755)
        tasks = sorted({task for source in sources for task in str(source.info["task"]).split("+")})
        config = {"made_by": f"svfl-data {verb}", **facts, "sources": [_origin(source) for source in sources]}
        new = Dataset.create_or_resume(aside, "+".join(tasks), int(sources[0].info["seed"]), config)
        for number, (source, index) in enumerate(progress(chosen, "copying episodes")):
            write_episode(_moved(source.read(index), source, number, verb), new.episode_path(number))
        os.replace(aside, destination)
    except OSError as error:
        raise StorageError(f"cannot create {destination}: {error.strerror}") from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return len(chosen)


def _origin(source: Dataset) -> dict[str, Any]:
    return {"dataset": _name(source), **{key: source.info.get(key) for key in ("task", "seed", "config")}}


def _moved(episode: Episode, source: Dataset, number: int, verb: str) -> Episode:
    came_from = {"dataset": _name(source), "index": episode.meta.index, "seed": episode.meta.seed}
    history = [*episode.meta.history, history_entry(verb, came_from=came_from)]
    return Episode(dataclasses.replace(episode.meta, index=number, history=history), episode.arrays, episode.name)


def _name(dataset: Dataset) -> str:
    """The folder's name; where it lies on this machine is nobody's business."""
    return dataset.path.resolve().name


def readable(dataset: Dataset) -> list[Entry]:
    """The index of a dataset all of whose episodes can be read.

    Raises:
        DatasetError: If one is damaged, or there are none.
    """
    found = entries(dataset)
    for entry in found:
        if entry.error:
            raise DatasetError(f"{entry.error}; see svfl-data validate and svfl-data repair")
    if not found:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    return found


def check_compatible(sources: Sequence[Dataset]) -> None:
    """Check that datasets have the same cameras with the same sizes, the same streams, and about the same rates.

    Raises:
        DatasetError: If they do not.
    """
    first, *others = [(source.path, dict(_traits(readable(source)))) for source in sources]
    for path, traits in others:
        for name in sorted(first[1].keys() | traits.keys()):
            here, there = traits.get(name), first[1].get(name)
            if not _same(here, there):
                raise DatasetError(
                    f"cannot merge: {name} is {_words(there)} in {first[0]}, but {_words(here)} in {path}"
                )


def _traits(found: Sequence[Entry]) -> Iterator[tuple[str, Any]]:
    """What the episodes of a dataset have in common, by name: sizes of cameras, and rates."""
    for name in sorted({name for entry in found for name in entry.cameras}):
        yield f"camera {name}", sorted({tuple(entry.cameras[name][2:]) for entry in found if name in entry.cameras})
        yield f"rate of camera {name}", _rate(entry.cameras[name][1] for entry in found if name in entry.cameras)
    for name in sorted({name for entry in found for name in entry.streams}):
        yield f"rate of {name}", _rate(entry.streams[name][1] for entry in found if name in entry.streams)


def _rate(rates: Iterator[float | None]) -> float:
    """The median rate of a stream, [Hz]; 0 if no episode has two readings."""
    return float(median([rate for rate in rates if rate is not None] or [0.0]))


def _same(here: object, there: object) -> bool:
    if isinstance(here, float) and isinstance(there, float):
        return abs(here - there) <= RATE_TOLERANCE * max(here, there) or 0.0 in (here, there)
    return here == there


def _words(trait: object) -> str:
    if trait is None:
        return "missing"
    if isinstance(trait, float):
        return f"{trait:.1f} Hz"
    assert isinstance(trait, list)
    return " and ".join(f"{height} x {width} px" for height, width in trait)
