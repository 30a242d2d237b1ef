"""What a dataset holds, at a glance: one line per episode in ``index.jsonl``, and their sum.

The index is a cache. A line counts only as long as the file it describes has the size and time of change that the
line names; every other episode is opened again, so that the files are always right and the index may be deleted. Lines
are appended with one write each, so that writers cannot mix theirs, and the last line of a name wins. A line that was
cut off by a crash is no line.
"""

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.duplicates import content_id
from svfl_data.datasets.shards import MEMBER
from svfl_data.errors import StorageError, SvflError
from svfl_data.schema.fields import EXTRA
from svfl_data.schema.recording_setup import Setup
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import know_own
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.progress import progress
from svfl_data.system.regular_file import open_regular
from svfl_data.system.side_files import Count, Int64

INDEX = "index.jsonl"
SIZE_LIMIT = 2**29
"""Bytes of an index that is believed: lines of a kilobyte or two for a quarter of a million episodes."""
LINE_LIMIT = 2**20


@dataclass(frozen=True)
class Entry:
    """One episode as the index knows it.

    Attributes:
        name: Its file in the dataset's folder; ``shard/member`` if it lies in a shard.
        index: Its position in the dataset.
        size: Size of the file (of the shard), [bytes].
        mtime_ns: Time of the file's last change, [ns].
        bytes: Size of the episode, [bytes].
        setup: With what it was recorded.
        content: Hash of what was recorded (`duplicates.content_id`).
        error: Why it cannot be read; empty if it can. Else nothing is known of it but its place.
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
    index: Count
    size: Count
    mtime_ns: Int64
    bytes: Count
    setup: Setup
    content: str
    error: str = ""
    task: str = ""
    source: str = ""
    seed: Int64 = 0
    success: bool = False
    steps: Count = 0
    seconds: float = 0.0
    format_version: str = ""
    streams: dict[str, tuple[Count, float | None]] = field(default_factory=dict)
    cameras: dict[str, tuple[Count, float | None, Count, Count]] = field(default_factory=dict)


_DECODER = msgspec.json.Decoder(Entry)


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

    Raises:
        FormatError: If a shard is damaged, or the index is no ordinary file.
        StorageError: If the folder cannot be read.
    """
    present = _present(dataset)
    known, lines = _known(dataset, present)
    unknown = sorted(present.keys() - known.keys())
    fresh = {name: _examine(dataset, present[name]) for name in progress(unknown, "reading episodes")}
    known |= {name: entry for name, entry in fresh.items() if not entry.error}  # what is damaged is looked at again
    _remember(dataset.path / INDEX, known, unknown, lines)
    return sorted((known | fresh).values(), key=lambda entry: entry.index)


def known_entries(dataset: Dataset) -> list[Entry]:
    """The episodes of a dataset that the index knows, by index; if there are none, the first that can be read.

    Quick whatever there is: for those that only need to know what kind of episodes there are.

    Raises:
        FormatError: If a shard is damaged, or the index is no ordinary file.
        StorageError: If the folder cannot be read.
    """
    present = _present(dataset)
    known, _ = _known(dataset, present)
    if known:
        return sorted(known.values(), key=lambda entry: entry.index)
    examined = (_examine(dataset, place) for place in sorted(present.values(), key=lambda place: place.index))
    return [entry for entry in [next((one for one in examined if not one.error), None)] if entry]


def _known(dataset: Dataset, present: "Mapping[str, _Place]") -> tuple[dict[str, Entry], int]:
    """The episodes that the index describes as they are now, by name, and the number of its lines."""
    lines = _read_lines(dataset.path / INDEX)
    known = {}
    for entry in lines:
        if present.get(entry.name) == _Place(entry.index, entry.size, entry.mtime_ns) and not entry.error:
            known[entry.name] = entry
    return known, len(lines)


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
    place = (name, int(match[1]) if match else 0, extent.file_size, extent.mtime_ns, extent.size)
    reader = EpisodeReader(extent)
    try:
        meta, rates = reader.meta, reader.rates
        clocks = [path for path in reader.paths if path.endswith("/t_ns") and not path.startswith(EXTRA)]
        streams = {path.split("/")[1]: path for path in clocks if path.startswith("streams/")}
        cameras = {path.split("/")[1]: path for path in clocks if path.startswith("cameras/")}
        sizes = {camera: reader[f"cameras/{camera}/color"].shape for camera in cameras}
        return Entry(
            *place, Setup.of(meta, {path: reader[path] for path in reader.paths}), content_id(reader), "",
            meta.task, meta.source, meta.seed, meta.success, len(reader), round(reader.seconds, 9),
            reader.format_version,
            {stream: (len(reader[path]), _rounded(rates.get(path))) for stream, path in streams.items()},
            {
                camera: (len(reader[path]), _rounded(rates.get(path)), sizes[camera][1], sizes[camera][2])
                for camera, path in cameras.items()
            },
        )  # fmt: skip
    except SvflError as error:
        return Entry(*place, Setup(), "", str(error))


def _rounded(rate: float | None) -> float | None:
    return None if rate is None else round(rate, 3)


@dataclass(frozen=True)
class _Place:
    """Which episode a name stands for, and the size and time of change of its file."""

    index: int
    size: int
    mtime_ns: int


def _present(dataset: Dataset) -> dict[str, _Place]:
    """Every episode by name, as cheaply as the system tells."""
    own, found = dataset.own_files(), {}
    for index, file in own.items():
        with suppress(FileNotFoundError):  # gone since it was listed
            state = os.lstat(file)
            found[file.name] = _Place(index, state.st_size, state.st_mtime_ns)
    for index, shard in dataset.packed().items():
        if index not in own:
            state = os.lstat(shard)
            found[f"{shard.name}/{dataset.file_name(index)}"] = _Place(index, state.st_size, state.st_mtime_ns)
    return found


def _examine(dataset: Dataset, place: _Place) -> Entry:
    try:
        return describe(dataset.extent(place.index))
    except SvflError as error:  # a link, a pipe, or gone since it was listed
        name = dataset.file_name(place.index)
        return Entry(name, place.index, place.size, place.mtime_ns, 0, Setup(), "", str(error))


def _read_lines(file: Path) -> list[Entry]:
    """The lines that are whole and of this version; none if there is no index, or one beyond all measure."""
    try:
        descriptor = open_regular(file)
    except OSError:
        return []
    lines = []
    with os.fdopen(descriptor, "rb") as text:
        if os.fstat(descriptor).st_size > SIZE_LIMIT:
            return []
        while line := text.readline(LINE_LIMIT):
            with suppress(msgspec.MsgspecError, RecursionError, UnicodeError):
                lines.append(_DECODER.decode(line))
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
        descriptor = open_regular(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        try:
            for entry in fresh:
                os.write(descriptor, _line(entry))
        finally:
            os.close(descriptor)
    except OSError as error:
        raise StorageError(f"cannot write {file}: {error.strerror}") from error


def _line(entry: Entry) -> bytes:
    return msgspec.json.encode(entry, order="deterministic") + b"\n"


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
