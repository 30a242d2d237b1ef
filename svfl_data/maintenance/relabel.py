"""Changing what is said about an episode, never what was recorded: the file is rewritten, with a history entry."""

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
from svfl_data.signals.contact import CONTACT, ContactRule, contact_annotations
from svfl_data.signals.transforms import Gravity, LowPass, Tare, as_record
from svfl_data.storage.store import read_episode, write_episode
from svfl_data.system.regular_file import open_regular

BY_HAND = {"tool": "svfl-data relabel --annotate"}

Change = Callable[[Episode], Meta]
"""What the metadata of an episode shall be; the history is not its business."""


def relabel(dataset: Dataset, index: int, change: Change) -> list[str]:
    """Change the metadata of one episode of a dataset; one that lies in a shard gets a file of its own before it.

    Of several that change an episode at once, each sees what the one before it has left.

    Returns:
        Names of what changed; empty if nothing did, and then the file is left alone.

    Raises:
        DatasetError: If there is no such episode.
        FormatError: If it is damaged.
        StorageError: If the disk refuses; the old file is then intact.
    """
    with _held(lambda: dataset.extent(index).file):
        return _rewrite(dataset.read(index, images=False), dataset.episode_path(index), change)


def relabel_file(file: Path, change: Change) -> list[str]:
    """Change the metadata of an episode file; see `relabel`."""
    with _held(lambda: file):
        return _rewrite(read_episode(file, images=False), file, change)


@contextmanager
def _held(find: Callable[[], Path]) -> Iterator[None]:
    """Lock the file that holds an episode, however often others replace it meanwhile.

    Args:
        find: Says which file that is now: the shard, until somebody gives the episode a file of its own.
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
    """Whether an open file is the one of that name."""
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
        write_episode(Episode(dataclasses.replace(meta, history=[*meta.history, entry]), episode.arrays), file)
    return changed


def history_entry(command: str, **facts: Any) -> dict[str, Any]:  # noqa: ANN401 - any JSON value
    """An entry of `Meta.history`: which tool of which version, when, and what it did."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return {"tool": f"svfl-data {command}", "version": version("svfl"), "time": now, **facts}


def with_success(success: bool) -> Change:
    """Say whether the task was achieved."""
    return lambda episode: dataclasses.replace(episode.meta, success=success)


def with_annotation(name: str, start_s: float, end_s: float) -> Change:
    """Add a named interval, in seconds of the episode clock.

    Raises:
        UsageError: When applied, if the interval does not lie within the episode.
    """

    def change(episode: Episode) -> Meta:
        last_s = max(int(clock[-1]) for clock in (episode.t_ns, episode.wrench_t_ns) if len(clock)) / 1e9
        if not 0 <= start_s <= end_s <= last_s:
            raise UsageError(
                f"--annotate {name} {start_s:g} {end_s:g}: needs 0 <= start <= end <= {last_s:g} s, "
                f"the end of {episode.name}"
            )
        found = {"name": name, "start_ns": round(start_s * 1e9), "end_ns": round(end_s * 1e9), "by": BY_HAND}
        return dataclasses.replace(episode.meta, annotations=_sorted([*episode.meta.annotations, found]))

    return change


def with_contacts(rule: ContactRule) -> Change:
    """Find contacts; those that were found by an earlier rule are replaced, those set by hand are kept."""

    def change(episode: Episode) -> Meta:
        kept = [one for one in episode.meta.annotations if one.get("name") != CONTACT or one.get("by") == BY_HAND]
        annotations = _sorted([*kept, *contact_annotations(episode, rule)])
        return dataclasses.replace(episode.meta, annotations=annotations)

    return change


def without_annotations(name: str) -> Change:
    """Remove the annotations of a name, whoever made them."""

    def change(episode: Episode) -> Meta:
        kept = [one for one in episode.meta.annotations if one.get("name") != name]
        return dataclasses.replace(episode.meta, annotations=kept)

    return change


def with_transforms(transforms: Sequence[Tare | LowPass | Gravity]) -> Change:
    """Record how the raw wrench becomes usable, in place of what was recorded before."""
    records = [as_record(transform) for transform in transforms]
    return lambda episode: dataclasses.replace(episode.meta, transforms=records)


def _sorted(annotations: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(annotations, key=lambda one: (one["start_ns"], one["end_ns"], one["name"]))
