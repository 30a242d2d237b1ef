"""Changes of an episode's metadata: the file is rewritten with a new history entry, and its arrays stay the same."""

import dataclasses
import fcntl
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.fields import EXTRA
from svfl_data.signals.contact import CONTACT, ContactRule, contact_annotations
from svfl_data.signals.transforms import Gravity, LowPass, Tare, as_record
from svfl_data.storage.store import read_episode, write_episode
from svfl_data.system.regular_file import open_regular

BY_HAND = {"tool": "svfl-data relabel --annotate"}

Change = Callable[[Episode], Meta]
"""Function that returns the new metadata of an episode. The history entry of the change is added afterwards."""


def relabel(dataset: Dataset, index: int, change: Change) -> list[str]:
    """Change the metadata of one episode of a dataset.

    An episode that lies in a shard gets a file of its own, which is read instead of the shard from then on. If several
    processes change an episode at once, they wait for each other, and each sees the changes of those before it.

    Args:
        dataset: Dataset that holds the episode.
        index: Index of the episode.
        change: Function that returns the new metadata of the episode.

    Returns:
        Names of the attributes of `Meta` that changed. If the list is empty, the file is not rewritten.

    Raises:
        DatasetError: If the dataset has no such episode.
        FormatError: If the episode is damaged.
        StorageError: If the disk refuses; the old file is then intact.
    """
    with _held(lambda: dataset.extent(index).file):
        return _rewrite(dataset.read(index, images=False), dataset.episode_path(index), change)


def relabel_file(file: Path, change: Change) -> list[str]:
    """Change the metadata of an episode file.

    Args:
        file: Path of the episode file.
        change: Function that returns the new metadata of the episode.

    Returns:
        Names of the attributes of `Meta` that changed. If the list is empty, the file is not rewritten.

    Raises:
        FormatError: If the file is missing or damaged.
        StorageError: If the disk refuses; the old file is then intact.
    """
    with _held(lambda: file):
        return _rewrite(read_episode(file, images=False), file, change)


@contextmanager
def _held(find: Callable[[], Path]) -> Iterator[None]:
    """Lock the file that holds an episode, even if others replace the file meanwhile.

    Args:
        find: Function that returns the file that holds the episode now. This is the shard until somebody gives the
            episode a file of its own.
    """
    while True:
        file = find()
        try:
            descriptor = open_regular(file)
        except OSError as error:
            raise FormatError(f"{file}: {error.strerror}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            if find() == file and _still_named(descriptor, file):
                yield
                return
        finally:
            os.close(descriptor)


def _still_named(descriptor: int, file: Path) -> bool:
    """Return whether an open file still has the given name."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(file))
    except FileNotFoundError:
        return False


def _rewrite(episode: Episode, file: Path, change: Change) -> list[str]:
    meta = change(episode)
    before, after = dataclasses.asdict(episode.meta), dataclasses.asdict(meta)
    changed = [key for key in after if after[key] != before[key]]
    if changed:
        entry = history_entry("relabel", replaced={key: before[key] for key in changed})
        meta = dataclasses.replace(meta, history=[*meta.history, entry])
        write_episode(dataclasses.replace(episode, meta=meta), file)
    return changed


def history_entry(command: str, **facts: Any) -> dict[str, Any]:  # noqa: ANN401 - any JSON value
    """Return an entry of `Meta.history`, which says which tool in which version did something, when, and what it did.

    Args:
        command: Command of ``svfl-data``, such as ``relabel``.
        facts: Further facts to store in the entry (JSON values).
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return {"tool": f"svfl-data {command}", "version": version("svfl"), "time": now, **facts}


def with_success(success: bool) -> Change:
    """Return a change that sets whether the task was achieved."""
    return lambda episode: dataclasses.replace(episode.meta, success=success)


def with_annotation(name: str, start_s: float, end_s: float) -> Change:
    """Return a change that adds an annotation.

    Args:
        name: Name of the annotation.
        start_s: Beginning of the interval on the episode clock, [s].
        end_s: End of the interval on the episode clock, [s].

    Raises:
        UsageError: When the change is applied, if the interval does not lie within the episode.
    """

    def change(episode: Episode) -> Meta:
        clocks = [
            times for path, times in episode.arrays.items() if path.endswith("/t_ns") and not path.startswith(EXTRA)
        ]
        last_s = max(int(clock[-1]) for clock in clocks if len(clock)) / 1e9
        if not 0 <= start_s <= end_s <= last_s:
            raise UsageError(
                f"--annotate {name} {start_s:g} {end_s:g}: needs 0 <= start <= end <= {last_s:g} s, "
                f"the end of {episode.name}"
            )
        found = {"name": name, "start_ns": round(start_s * 1e9), "end_ns": round(end_s * 1e9), "by": BY_HAND}
        return dataclasses.replace(episode.meta, annotations=_sorted([*episode.meta.annotations, found]))

    return change


def with_contacts(rule: ContactRule) -> Change:
    """Return a change that annotates the contacts that a rule finds.

    Contacts that an earlier rule found are replaced. Contacts that were annotated by hand are kept.

    Args:
        rule: Thresholds and durations by which contacts are found in the wrench stream.
    """

    def change(episode: Episode) -> Meta:
        kept = [one for one in episode.meta.annotations if one.get("name") != CONTACT or one.get("by") == BY_HAND]
        annotations = _sorted([*kept, *contact_annotations(episode, rule)])
        return dataclasses.replace(episode.meta, annotations=annotations)

    return change


def without_annotations(name: str) -> Change:
    """Return a change that removes all annotations of a name, by whomever they were made."""

    def change(episode: Episode) -> Meta:
        kept = [one for one in episode.meta.annotations if one.get("name") != name]
        return dataclasses.replace(episode.meta, annotations=kept)

    return change


def with_transforms(transforms: Sequence[Tare | LowPass | Gravity]) -> Change:
    """Return a change that replaces the recorded transforms, which make the raw wrench usable.

    Args:
        transforms: New transforms, in the order in which they are applied.
    """
    records = [as_record(transform) for transform in transforms]
    return lambda episode: dataclasses.replace(episode.meta, transforms=records)


def _sorted(annotations: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(annotations, key=lambda one: (one["start_ns"], one["end_ns"], one["name"]))
