"""The index of a dataset, which has one line per episode in ``index.jsonl``, and a summary of the dataset.

The index is a cache. A line counts only as long as the file that it describes has the size and the modification time
that the line states. Every other episode is opened again, so that the files are always right and the index may be
deleted. Each line is appended with a single write, so that the lines of several writers cannot mix, and the last line
of a name counts. A line that was cut off by a crash is ignored.
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
from svfl_data.datasets.recording_setup import Setup
from svfl_data.datasets.shards import MEMBER
from svfl_data.errors import FormatError, OldVersionError, StorageError, SvflError
from svfl_data.schema.fields import EXTRA
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import FORMAT_VERSION, header, know_own
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.progress import progress
from svfl_data.system.regular_file import open_regular
from svfl_data.system.side_files import Count, Int64, reads

INDEX = "index.jsonl"
SIZE_LIMIT = 2**29
"""Largest size of an index that is read, [bytes]. It is enough for a quarter of a million episodes with lines of one to
two kilobytes."""
LINE_LIMIT = 2**20
LONGEST_SAID = 200
"""Largest number of characters of an instruction, a robot, an operator or of software that the index keeps."""


@dataclass(frozen=True)
class Entry:
    """Line of the index, which describes one episode.

    Attributes:
        name: Name of the episode's file in the folder of the dataset, or ``shard/member`` if the episode lies in a
            shard.
        index: Index of the episode in the dataset.
        size: Size of the file, or of the whole shard, [bytes].
        mtime_ns: Time of the last change of the file or shard, [ns].
        bytes: Size of the episode, [bytes].
        setup: Recording setup of the episode.
        content: Hash of what was recorded (`duplicates.content_id`).
        error: Why the episode cannot be read; empty if it can be read. If it is not empty, the attributes above
            describe only the file, and the other attributes are empty.
        task: Name of the task.
        source: Who chose the actions (`Meta.source`).
        seed: Seed of the dataset for which the episode was recorded.
        success: Whether the task was achieved.
        steps: Number of actions.
        seconds: Time from the first to the last observation, [s].
        format_version: Format version of the file.
        streams: Number of rows and mean rate [Hz] of each stream by name. The rate is None with fewer than two rows.
        cameras: Number of rows, mean rate [Hz], image height and image width [px] of each camera by name. The rate is
            None with fewer than two rows.
        instruction: What was to be done, in words, cut to `LONGEST_SAID` characters; empty if not given. A line
            without one of these last attributes is of an earlier version and does not count.
        robot: Name of the robot, likewise.
        operator: Who operated the robot, likewise.
        software: Packages that recorded the episode, each with its version, in words, likewise.
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
    instruction: str = field(kw_only=True)
    robot: str = field(kw_only=True)
    operator: str = field(kw_only=True)
    software: str = field(kw_only=True)


_DECODER = msgspec.json.Decoder(Entry)


@dataclass(frozen=True)
class Summary:
    """Figures that summarise a dataset.

    Attributes:
        episodes: Number of episodes that can be read.
        damaged: Reason why each other episode cannot be read, by name.
        steps: Number of actions in all episodes.
        seconds: Duration of all episodes, [s].
        bytes: Size of all episodes, damaged ones included, [bytes].
        successes: Number of episodes that achieved their task.
        tasks: Number of episodes by task.
        instructions: Number of episodes by instruction, of those that say one.
        robots: Number of episodes by name of the robot, of those that say one.
        operators: Number of episodes by operator, of those that name one.
        recorded_with: Number of episodes by the packages that recorded them, in words, of those that name any.
        sources: Number of episodes by source.
        format_versions: Number of episodes by format version.
        streams: Figures of each stream by name: number of episodes that have it (``episodes``), number of rows
            (``rows``), lowest and highest mean rate [Hz] (``rate_hz``, or None).
        cameras: Figures of each camera by name: the same as for a stream, and the image sizes (``sizes``, [height,
            width], [px]).
    """

    episodes: int
    damaged: dict[str, str]
    steps: int
    seconds: float
    bytes: int
    successes: int
    tasks: dict[str, int]
    instructions: dict[str, int]
    robots: dict[str, int]
    operators: dict[str, int]
    recorded_with: dict[str, int]
    sources: dict[str, int]
    format_versions: dict[str, int]
    streams: dict[str, dict[str, Any]]
    cameras: dict[str, dict[str, Any]]


def entries(dataset: Dataset) -> list[Entry]:
    """Return the index entries of all episodes of a dataset, in the order of their indices.

    An episode that is not in the index is opened, and its entry is added to the index.

    Args:
        dataset: Dataset whose episodes are listed. If its folder is read-only, nothing is added to the index.

    Raises:
        OldVersionError: If an episode is of version 1 of the format; nothing is added to the index.
        FormatError: If a shard is damaged, or the index is not an ordinary file.
        StorageError: If the folder cannot be read.
    """
    present = _present(dataset)
    known, lines = _known(dataset, present)
    unknown = sorted(present.keys() - known.keys())
    fresh = {name: _examine(dataset, present[name]) for name in progress(unknown, "reading episodes")}
    known |= {name: entry for name, entry in fresh.items() if not entry.error}  # damaged episodes are opened again
    _remember(dataset.path / INDEX, known, unknown, lines)
    return sorted((known | fresh).values(), key=lambda entry: entry.index)


def known_entries(dataset: Dataset) -> list[Entry]:
    """Return the entries that are in the index already, in the order of their indices.

    If there are none, the result is the entry of the first episode that can be read. This function is quick for a
    dataset of any size, for callers that only need to know what kind of episodes there are.

    Args:
        dataset: Dataset whose episodes are listed.

    Raises:
        FormatError: If a shard is damaged, or the index is not an ordinary file.
        StorageError: If the folder cannot be read.
    """
    present = _present(dataset)
    known, _ = _known(dataset, present)
    if known:
        return sorted(known.values(), key=lambda entry: entry.index)
    examined = (_examine(dataset, place) for place in sorted(present.values(), key=lambda place: place.index))
    return [entry for entry in [next((one for one in examined if not one.error), None)] if entry]


def _known(dataset: Dataset, present: "Mapping[str, _Place]") -> tuple[dict[str, Entry], int]:
    """Return the entries that describe episodes as they are now, by name, and the number of lines of the index."""
    lines = _read_lines(dataset.path / INDEX)
    known = {}
    for entry in lines:
        current = reads(FORMAT_VERSION, entry.format_version) and not entry.error
        if current and present.get(entry.name) == _Place(entry.index, entry.size, entry.mtime_ns):
            known[entry.name] = entry
    return known, len(lines)


def summary(dataset: Dataset) -> Summary:
    """Return the figures that summarise a dataset; this is quick if the index is up to date.

    Args:
        dataset: Dataset to summarise.

    Raises:
        FormatError: If a shard is damaged, or the index is not an ordinary file.
        StorageError: If the folder cannot be read.
    """
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
        instructions=dict(Counter(entry.instruction for entry in good if entry.instruction)),
        robots=dict(Counter(entry.robot for entry in good if entry.robot)),
        operators=dict(Counter(entry.operator for entry in good if entry.operator)),
        recorded_with=dict(Counter(entry.software for entry in good if entry.software)),
        sources=dict(Counter(entry.source for entry in good)),
        format_versions=dict(Counter(entry.format_version for entry in good)),
        streams=_gathered([entry.streams for entry in good]),
        cameras=_gathered([entry.cameras for entry in good]),
    )


def refuse_old(dataset: Dataset) -> None:
    """Refuse a dataset of version 1 of the format, by its first episode that can be read.

    Commands that do not read the episodes call this function, so that they neither copy nor change what no command can
    use.

    Args:
        dataset: Dataset that a command is about to copy or to change.

    Raises:
        OldVersionError: If the episode is of version 1.
        StorageError: If the folder cannot be read.
    """
    try:
        indices = dataset.indices
    except FormatError:  # a damaged shard, of which other functions say more
        indices = sorted(dataset.own_files())
    for index in indices:
        try:
            header(dataset.extent(index))
            return
        except OldVersionError:
            raise
        except SvflError:
            continue


def append_index(folder: Path, path: Path) -> None:
    """Add a line to the index for an episode that was just published.

    Any number of processes may do so at once.

    Args:
        folder: Folder of the dataset.
        path: File of the episode in this folder.

    Raises:
        FormatError: If the episode's file or the index is not an ordinary file.
        StorageError: If the disk refuses the write. The index then lacks a line, which costs time and nothing else.
    """
    extent = Extent.of_file(path)
    with suppress(SvflError):  # `describe` reports what is wrong with the episode
        know_own(extent)
    _append(folder / INDEX, [describe(extent)])


def describe(extent: Extent) -> Entry:
    """Open an episode and return its index entry, which holds the error if the episode is damaged.

    Args:
        extent: File and byte range of the episode.

    Raises:
        OldVersionError: If the episode is of version 1 of the format.
    """
    name = f"{extent.file.name}/{extent.member}" if extent.member else extent.file.name
    match = MEMBER.fullmatch(extent.member or extent.file.name)
    place = (name, int(match[1]) if match else 0, extent.file_size, extent.mtime_ns, extent.size)
    reader = EpisodeReader(extent)
    try:
        meta, rates = reader.meta, reader.rates
        clocks = [path for path in reader.paths if path.endswith("/t_ns") and not path.startswith(EXTRA)]
        streams = {path.split("/")[1]: path for path in clocks if path.startswith("streams/")}
        cameras = {path.split("/")[1]: path for path in clocks if path.startswith("cameras/")}
        sizes = {camera: reader.image_size(camera) for camera in cameras}
        setup = Setup.of(meta, {path: reader[path] for path in reader.paths}, reader.declarations)
        return Entry(
            *place, setup, content_id(reader), "",
            meta.task, meta.source, meta.seed, meta.success, len(reader), round(reader.seconds, 9),
            reader.format_version,
            {stream: (len(reader[path]), _rounded(rates.get(path))) for stream, path in streams.items()},
            {
                camera: (len(reader[path]), _rounded(rates.get(path)), *sizes[camera])
                for camera, path in cameras.items()
            },
            instruction=meta.instruction[:LONGEST_SAID], robot=meta.robot[:LONGEST_SAID],
            operator=meta.operator[:LONGEST_SAID], software=software_words(meta.software)[:LONGEST_SAID],
        )  # fmt: skip
    except OldVersionError:
        raise
    except SvflError as error:
        return _unreadable(place, error)


def software_words(software: Mapping[str, str]) -> str:
    """Return the packages that recorded an episode in words, each with its version.

    Args:
        software: Versions by name of the package, as `Meta.software` holds them.
    """
    return ", ".join(f"{name} {version}" for name, version in software.items())


def _rounded(rate: float | None) -> float | None:
    return None if rate is None else round(rate, 3)


@dataclass(frozen=True)
class _Place:
    """Index of an episode, and the size and the modification time of the file in which it lies."""

    index: int
    size: int
    mtime_ns: int


def _present(dataset: Dataset) -> dict[str, _Place]:
    """Return the place of every episode by name, without opening an episode."""
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
    except OldVersionError:
        raise
    except SvflError as error:  # a link, a pipe, or gone since it was listed
        name = dataset.file_name(place.index)
        return _unreadable((name, place.index, place.size, place.mtime_ns, 0), error)


def _unreadable(place: tuple[str, int, int, int, int], error: SvflError) -> Entry:
    return Entry(*place, Setup(), "", str(error), instruction="", robot="", operator="", software="")


def _read_lines(file: Path) -> list[Entry]:
    """Return the lines that are complete and of this version; none if there is no index, or one beyond `SIZE_LIMIT`."""
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
            for line in map(_line, fresh):
                if len(line) <= LINE_LIMIT:  # a longer one would not be read again
                    os.write(descriptor, line)
        finally:
            os.close(descriptor)
    except OSError as error:
        raise StorageError(f"cannot write {file}: {error.strerror}") from error


def _line(entry: Entry) -> bytes:
    return msgspec.json.encode(entry, order="deterministic") + b"\n"


def _gathered(each: Iterable[Mapping[str, Sequence[Any]]]) -> dict[str, dict[str, Any]]:
    """Return what `Summary` says of streams or cameras, from their rows, rate and image size in every episode."""
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
