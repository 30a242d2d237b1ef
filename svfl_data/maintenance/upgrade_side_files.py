"""Files beside the episodes of a dataset that is upgraded: splits, statistics and journals of recordings."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from svfl_data.datasets.dataset import FAILURES, SPLITS, Dataset, inner_folder
from svfl_data.datasets.dataset_info import INFO
from svfl_data.datasets.fingerprint import fingerprint
from svfl_data.datasets.index import INDEX
from svfl_data.datasets.shards import shard_files
from svfl_data.errors import DatasetError, FormatError
from svfl_data.maintenance.pack import side_content
from svfl_data.recording.index_locks import INFLIGHT
from svfl_data.recording.journal import SUFFIX
from svfl_data.schema.episode import canonical_json
from svfl_data.storage.chunks import Extent
from svfl_data.system.atomic_io import write_atomically, written_aside
from svfl_data.system.regular_file import refuse_link
from svfl_data.system.side_files import Count, parse_as, parse_json

STATISTICS = ".statistics.json"
SEALS = "episodes_sha256"
"""Key of a file of statistics that holds the fingerprint of the training episodes."""


class _Split(msgspec.Struct):
    parts: dict[str, list[Count]]


class _Statistics(msgspec.Struct):
    part: str
    episodes_sha256: str


def copy_splits(old: Dataset, new: Dataset) -> None:
    """Copy the splits of a dataset and their statistics.

    A split names episodes by number, so it is copied as it is. Statistics also name the seals of the episodes from
    which they were taken. They get the new seals if they were those of the old episodes.

    Args:
        old: Dataset with the splits.
        new: Upgraded dataset.

    Raises:
        FormatError: If a file is a link, is too large or cannot be read.
        StorageError: If the disk refuses.
    """
    refuse_link(old.path / SPLITS)
    for file in sorted((old.path / SPLITS).glob("*.json")):
        content = side_content(file)
        if file.name.endswith(STATISTICS):
            content = _with_new_seals(content, file, old, new)
        write_atomically(inner_folder(new.path, SPLITS) / file.name, content)


def _with_new_seals(content: bytes, file: Path, old: Dataset, new: Dataset) -> bytes:
    """Return the content of a file of statistics with the new seals; unchanged if it is not what it should be."""
    split = file.with_name(file.name.removesuffix(STATISTICS) + ".json")
    with suppress(FormatError, DatasetError):
        found: dict[str, Any] = parse_json(content, file)
        known = parse_as(found, _Statistics, file)
        episodes = parse_as(parse_json(side_content(split), split), _Split, split).parts.get(known.part, [])
        if known.episodes_sha256 == fingerprint(old, episodes):
            return (canonical_json(found | {SEALS: fingerprint(new, episodes)}) + "\n").encode()
    return content


def copy_journals(old: Dataset, new: Dataset) -> int:
    """Copy the journals of unfinished recordings, of which ``svfl-data repair`` makes episodes in the new dataset.

    Args:
        old: Dataset with the journals.
        new: Upgraded dataset.

    Returns:
        Number of journals.

    Raises:
        FormatError: If a journal is not an ordinary file, or changes while it is read.
        StorageError: If the disk refuses.
    """
    refuse_link(old.path / INFLIGHT)
    journals = sorted((old.path / INFLIGHT).glob(f"*{SUFFIX}"))
    for journal in journals:
        extent = Extent.of_file(journal)
        with written_aside(inner_folder(new.path, INFLIGHT) / journal.name, extent.size) as file:
            for block in extent.blocks():
                file.write(block)
    return len(journals)


def others(dataset: Dataset) -> list[str]:
    """Return the names of what lies in the folder of a dataset and is not part of it, such as its card.

    Args:
        dataset: Dataset to list. Hidden files, such as the leftovers of killed writers, are not named.
    """
    own = {INFO, INDEX, SPLITS, FAILURES, *(file.name for file in dataset.own_files().values())}
    own |= {shard.name for shard in shard_files(dataset.path)}
    return sorted(path.name for path in dataset.path.iterdir() if path.name not in own and path.name[0] != ".")
