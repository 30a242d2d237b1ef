"""What a dataset holds, at a glance: one line per episode in ``index.jsonl``, and their sum.

The index is a cache. A line counts only as long as the file it describes has the size and time of change that the
line names; every other episode is opened again, so that the files are always right and the index may be deleted. Lines
are appended with one write each, so that writers cannot mix theirs, and the last line of a name wins. A line that was
cut off by a crash is no line.
"""

import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from svfl_data.atomically import write_atomically
from svfl_data.chunks import Extent
from svfl_data.dataset import Dataset
from svfl_data.episode import canonical_json
from svfl_data.errors import StorageError, SvflError
from svfl_data.fields import EXTRA
from svfl_data.header import know_own
from svfl_data.progress import progress
from svfl_data.reader import EpisodeReader
from svfl_data.shards import MEMBER, members, shard_files

INDEX = "index.jsonl"


@dataclass(frozen=True)
class Entry:
    """One episode as the index knows it.

    Attributes:
        name: Its file in the dataset's folder; ``shard/member`` if it lies in a shard.
        index: Its position in the dataset.
        size: Size of the file (of the shard), [bytes].
        mtime_ns: Time of the file's last change, [ns].
        bytes: Size of the episode, [bytes].
        error: Why it cannot be read; empty if it can. Then nothing below is known.
        task: What it is about.
        source: Who acted.
        seed: Seed of its dataset.
        success: Whether the task was achieved.
        steps: Number of actions.
        seconds: From the first to the last observation, [s].
        format_version: Of the file.
        streams: Rows and mean rate [Hz] of each stream by name; the rate is null with fewer than two rows.
        cameras: Rows, mean rate [Hz], height and width [px] of each camera by name.
    """

    name: str
    index: int
    size: int
    mtime_ns: int
    bytes: int
    error: str = ""
    task: str = ""
    source: str = ""
    seed: int = 0
    success: bool = False
    steps: int = 0
    seconds: float = 0.0
    format_version: str = ""
    streams: dict[str, list[Any]] = field(default_factory=dict)
    cameras: dict[str, list[Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Summary:
    """A dataset in figures.

    Attributes:
        episodes: How many can be read.
        damaged: Name and reason of those that cannot.
        steps: Actions in all.
        seconds: Duration of all, [s].
        bytes: Size of all, [bytes].
        successes: How many achieved their task.
        tasks: Episodes by task.
        sources: Episodes by source.
        format_versions: Episodes by format version.
        streams: Of each stream: episodes that have it, rows, lowest and highest mean rate [Hz].
        cameras: Of each camera: episodes that have it, rows, lowest and highest mean rate [Hz], and its image sizes.
    """

    episodes: int
    damaged: dict[str, str]
    steps: int
    seconds: float
    bytes: int
    successes: int
    tasks: dict[str, int]
    sources: dict[str, int]
    format_versions: dict[str, int]
    streams: dict[str, dict[str, Any]]
    cameras: dict[str, dict[str, Any]]


def entries(dataset: Dataset) -> list[Entry]:
    """Every episode of a dataset, by index; opens those that the index does not know, and remembers them.

    Args:
        dataset: Which; if its folder is read-only, nothing is remembered.
    """
    present = {name: (size, mtime_ns) for name, size, mtime_ns in _present(dataset)}
    lines = _read_lines(dataset.path / INDEX)
    known = {entry.name: entry for entry in lines if present.get(entry.name) == (entry.size, entry.mtime_ns)}
    unknown = sorted(present.keys() - known.keys())
    fresh = {name: _examine(dataset, name) for name in progress(unknown, "reading episodes")}
    known |= {name: entry for name, entry in fresh.items() if not entry.error}  # what is damaged is looked at again
    _remember(dataset.path / INDEX, known, unknown, len(lines))
    return sorted((known | fresh).values(), key=lambda entry: entry.index)


def summary(dataset: Dataset) -> Summary:
    """A dataset in figures; quick if the index is up to date."""
    found = entries(dataset)
    good = [entry for entry in found if not entry.error]
    return Summary(
        episodes=len(good),
        damaged={entry.name: entry.error for entry in found if entry.error},
        steps=sum(entry.steps for entry in good),
        seconds=sum(entry.seconds for entry in good),
        bytes=sum(entry.bytes for entry in found),
        successes=sum(entry.success for entry in good),
        tasks=dict(Counter(entry.task for entry in good)),
        sources=dict(Counter(entry.source for entry in good)),
        format_versions=dict(Counter(entry.format_version for entry in good)),
        streams=_gathered([entry.streams for entry in good]),
        cameras=_gathered([entry.cameras for entry in good]),
    )


def append_index(folder: Path, path: Path) -> None:
    """Add a line for an episode that was just published; any number of processes may do so at once.

    Args:
        folder: The dataset's.
        path: The episode's file in it.

    Raises:
        StorageError: If the disk refuses. The index then lacks a line, which costs time and nothing else.
    """
    extent = Extent.of_file(path)
    with suppress(SvflError):  # what is wrong with it, its description says
        know_own(extent)
    _append(folder / INDEX, [describe(extent)])


def describe(extent: Extent) -> Entry:
    """Open an episode and describe it; damage is described as well."""
    name = f"{extent.file.name}/{extent.member}" if extent.member else extent.file.name
    match = MEMBER.fullmatch(extent.member or extent.file.name)
    place = (name, int(match[1]) if match else -1, extent.file_size, extent.mtime_ns, extent.size)
    reader = EpisodeReader(extent)
    try:
        meta, rates = reader.meta, reader.rates
        clocks = [path for path in reader.paths if path.endswith("/t_ns") and not path.startswith(EXTRA)]
        streams = {path.split("/")[1]: path for path in clocks if path.startswith("streams/")}
        cameras = {path.split("/")[1]: path for path in clocks if path.startswith("cameras/")}
        return Entry(
            *place, "", meta.task, meta.source, meta.seed, meta.success, len(reader), round(reader.seconds, 9),
            reader.format_version,
            {stream: [len(reader[path]), _rounded(rates.get(path))] for stream, path in streams.items()},
            {
                camera: [len(reader[path]), _rounded(rates.get(path)), *reader[f"cameras/{camera}/color"].shape[1:3]]
                for camera, path in cameras.items()
            },
        )  # fmt: skip
    except SvflError as error:
        return Entry(*place, error=str(error))


def _rounded(rate: float | None) -> float | None:
    return None if rate is None else round(rate, 3)


def _present(dataset: Dataset) -> Iterator[tuple[str, int, int]]:
    """Name, size and time of change of every episode, as cheaply as the system tells."""
    own = set()
    with os.scandir(dataset.path) as listing:
        for item in listing:
            if match := MEMBER.fullmatch(item.name):
                found = item.stat()
                own.add(int(match[1]))
                yield item.name, found.st_size, found.st_mtime_ns
    seen = own
    for shard in reversed(shard_files(dataset.path)):  # as in `Dataset.extent`: own files first, then later shards
        found = shard.stat()
        for index, info in members(shard).items():
            if index not in seen:
                yield f"{shard.name}/{info.filename}", found.st_size, found.st_mtime_ns
        seen = seen | members(shard).keys()


def _examine(dataset: Dataset, name: str) -> Entry:
    match = MEMBER.fullmatch(name.rpartition("/")[2])
    assert match, name
    return describe(dataset.extent(int(match[1])))


def _read_lines(file: Path) -> list[Entry]:
    """The lines that are whole and of this version; none if there is no index."""
    lines = []
    try:
        with open(file, encoding="utf-8", errors="replace") as text:
            for line in text:
                try:
                    lines.append(Entry(**json.loads(line)))
                except (ValueError, TypeError):
                    continue
    except OSError:
        return []
    return lines


def _remember(file: Path, known: dict[str, Entry], unknown: list[str], lines: int) -> None:
    fresh = [known[name] for name in unknown if name in known]
    try:
        if lines + len(fresh) > 2 * len(known) + 10:  # mostly lines that no longer count
            write_atomically(file, b"".join(map(_line, known.values())))
        elif fresh:
            _append(file, fresh)
    except StorageError:
        pass  # a folder that cannot be written can still be read


def _append(file: Path, fresh: list[Entry]) -> None:
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            for entry in fresh:
                os.write(descriptor, _line(entry))
        finally:
            os.close(descriptor)
    except OSError as error:
        raise StorageError(f"cannot write {file}: {error.strerror}") from error


def _line(entry: Entry) -> bytes:
    return (canonical_json(asdict(entry)) + "\n").encode()


def _gathered(each: Iterable[Mapping[str, Sequence[Any]]]) -> dict[str, dict[str, Any]]:
    """What `Summary` says of streams and cameras, from rows, rate and image size in every episode."""
    gathered: dict[str, dict[str, Any]] = {}
    for name, (rows, rate, *size) in (item for episode in each for item in episode.items()):
        sum_ = gathered.setdefault(name, {"episodes": 0, "rows": 0, "rate_hz": None})
        sum_["episodes"] += 1
        sum_["rows"] += rows
        if rate is not None:
            low, high = sum_["rate_hz"] or (rate, rate)
            sum_["rate_hz"] = (min(low, rate), max(high, rate))
        if size and size not in sum_.setdefault("sizes", []):
            sum_["sizes"].append(size)
    return gathered
