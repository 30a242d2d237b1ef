"""``svfl-data info``: print facts about a dataset or an episode."""

import argparse
import dataclasses
from contextlib import suppress
from typing import Any

from svfl_data.commands.arguments import add_episode, add_path
from svfl_data.commands.source import is_episode, reader
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import Identity, identity
from svfl_data.datasets.index import LONGEST_SAID as LONGEST_KEPT
from svfl_data.datasets.index import Summary, software_words, summary
from svfl_data.errors import SvflError
from svfl_data.schema.field import Field
from svfl_data.schema.field_words import camera_pose, meaning, own, title
from svfl_data.schema.rates import declared_hz
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.command_line import Commands, add_json, report
from svfl_data.system.printable import printable

SECONDS_PER_HOUR = 3600
LONGEST_SAID = 80
"""Largest number of characters of an instruction that are printed for a dataset."""
MOST_NAMED = 20
"""Largest number of tasks, sources, damaged files and similar items that are named; of others only their number."""


def add(commands: Commands) -> None:
    """Add the command ``info`` and its arguments to the command line."""
    parser = commands.add_parser(
        "info",
        help="print what a dataset holds: episodes, steps, hours, tasks, streams and fields with units, size",
        description="Print what a dataset holds: episodes, steps, hours, tasks, instructions, robots, success rate, "
        "sources, streams with rate and unit, cameras with size, rate and place, actions and fields of your own with "
        "unit, axes, bounds and what is assumed, bytes, operators, versions, and the identity: a hash over the seals "
        "of all episodes, by which runs identify their training data. With --episode, or if PATH is an "
        "episode file, print the details of one episode.",
        example="svfl-data info data/centering\nsvfl-data info data/centering --episode 3 --json",
    )
    add_path(parser)
    add_episode(parser, otherwise="the whole dataset")
    add_json(parser)
    parser.set_defaults(command=run)


NAMED = {"instruction": "to do", "robot": "robot", "operator": "operator"}
"""Attributes of an episode that are printed if they are known, and how they are called."""


def run(arguments: argparse.Namespace) -> None:
    """Print the facts, as text or as JSON."""
    if is_episode(arguments.path) or arguments.episode is not None:
        episode = reader(arguments.path, arguments.episode)
        report(arguments.json, episode_facts(episode), *episode_lines(episode))
        return
    dataset = Dataset.open(arguments.path)
    found = summary(dataset)
    first = _first_readable(dataset) if found.episodes else None
    software = first.meta.software if first else {}
    strays, who = dataset.strays(), identity(dataset)
    facts = {"path": dataset.path, "info": dataset.info, "software": software, "not_counted": strays}
    facts |= {**dataclasses.asdict(found), "identity": dataclasses.asdict(who)}
    facts["fields"] = field_facts(first) if first else {}
    report(arguments.json, facts, *dataset_lines(dataset, found, first, strays, who))


def _first_readable(dataset: Dataset) -> EpisodeReader | None:
    for index in dataset.indices:
        with suppress(SvflError):
            reader = dataset.episode(index)
            if reader.meta and reader.paths:
                return reader
    return None


def units(group: str, episode: EpisodeReader | None) -> str:
    """Return the units of the recorded arrays of a stream, from their declarations.

    Args:
        group: Group of the arrays, such as ``streams/wrench``, which gives ``N, N m``.
        episode: Episode with the stream; None if there is none that can be read.
    """
    fields = episode.declarations.in_group(group) if episode else ()
    declared = [one.unit for one in fields if episode and one.path in episode and not one.path.endswith("/t_ns")]
    return ", ".join(dict.fromkeys(unit for one in declared for unit in one.split(", ") if unit != "-")) or "-"


def dataset_lines(
    dataset: Dataset, found: Summary, first: EpisodeReader | None, strays: list[str], who: Identity
) -> list[str]:
    """Return a description of a dataset in a few lines of text.

    Args:
        dataset: Dataset to describe.
        found: Summary of the dataset.
        first: First episode, whose declarations are shown; None if it cannot be read.
        strays: Names of files that look like episode files but are not counted, because their names are not exact.
        who: Identity of the dataset.
    """
    rate = f"{found.successes / found.episodes:.1%}" if found.episodes else "-"
    lines = [
        f"{dataset.path}: {found.episodes} episodes, {found.steps} steps, "
        f"{found.seconds / SECONDS_PER_HOUR:.3g} hours, {size_words(found.bytes)}",
        f"  tasks     {_counts(found.tasks)}",
        *([f"  to do     {_counts(found.instructions, LONGEST_SAID)}"] if found.instructions else []),
        *([f"  robots    {_counts(found.robots)}"] if found.robots else []),
        *([f"  operators {_counts(found.operators)}"] if found.operators else []),
        f"  sources   {_counts(found.sources)}",
        f"  success   {found.successes} of {found.episodes} ({rate})",
    ]
    for name, stream in found.streams.items():
        known = units(f"streams/{name}", first)
        lines.append(f"  stream    {printable(name, 40)}: {_rates(stream)}, {stream['rows']} readings, [{known}]")
    for name, camera in found.cameras.items():
        sizes = " and ".join(f"{height} x {width} px" for height, width in camera["sizes"][:MOST_NAMED])
        where = camera_pose(name, first.paths) if first else ""
        moving = f", {where}" if where else ""
        lines.append(f"  camera    {printable(name, 40)}: {sizes}, {_rates(camera)}, {camera['rows']} frames{moving}")
    fields = _told(first) if first else []
    more = [f"  field     and {len(fields) - MOST_NAMED} more"] if len(fields) > MOST_NAMED else []
    lines += [*(f"  field     {_field_words(field)}" for field in fields[:MOST_NAMED]), *more]
    lines += [
        f"  format    {_counts(found.format_versions)}",
        f"  software  {_software(found)}",
        f"  identity  {who}",
        *_some("damaged", list(found.damaged.values())),
        *_some("no name", [f"{name}: not counted; an episode is named like episode_000012.hdf5" for name in strays]),
    ]
    return [printable(line) for line in lines]


def _told(episode: EpisodeReader) -> list[Field]:
    """Return the fields that are shown for a dataset: actions, the user's own ones, and those with an assumption."""
    declared = [field for path in episode.paths if (field := episode.declarations.at(path))]
    mine = {field.path for field in own(episode.paths, episode.declarations)}
    return [field for field in declared if field.assumed or field.path in mine or field.group == "actions"]


def _field_words(field: Field) -> str:
    row = f" {field.shape_words}" if field.shape else ""
    said = meaning(field)
    return f"{title(field, whole=True)}: {field.dtype}{row}{', ' + said if said else ''}"


def _some(head: str, words: list[str]) -> list[str]:
    """Return one line for each of the first `MOST_NAMED` items, and a line on how many more there are."""
    more = [f"  {head:9} and {len(words) - MOST_NAMED} more"] if len(words) > MOST_NAMED else []
    return [*(f"  {head:9} {printable(one)}" for one in words[:MOST_NAMED]), *more]


def _software(found: Summary) -> str:
    """Return the packages that recorded the episodes, with numbers of episodes if these differ in them."""
    counts = found.recorded_with
    if len(counts) == 1 and sum(counts.values()) == found.episodes:
        return printable(next(iter(counts)), LONGEST_KEPT)
    return _counts(counts, LONGEST_KEPT, "; ") if counts else "unknown"


def _counts(counts: dict[str, int], longest: int = 40, between: str = ", ") -> str:
    named = [f"{printable(name, longest)} ({count})" for name, count in counts.items()]
    more = [f"{len(named) - MOST_NAMED} more"] if len(named) > MOST_NAMED else []
    return between.join([*named[:MOST_NAMED], *more]) or "-"


def _rates(stream: dict[str, Any]) -> str:
    if stream["rate_hz"] is None:
        return "no rate"
    low, high = stream["rate_hz"]
    return f"{low:.4g} Hz" if f"{low:.4g}" == f"{high:.4g}" else f"{low:.4g} to {high:.4g} Hz"


def size_words(size: int) -> str:
    """Return a number of bytes as text with a unit, such as ``1.5 MB``.

    Args:
        size: Size, [bytes].
    """
    value, unit = float(size), "bytes"
    for larger in ("kB", "MB", "GB", "TB"):
        if value < 1000:
            break
        value, unit = value / 1000, larger
    return f"{value:.3g} {unit}"


def episode_facts(episode: EpisodeReader) -> dict[str, Any]:
    """Return the facts about an episode as JSON values.

    Args:
        episode: Reader of the episode.
    """
    rates = episode.rates
    arrays = {
        path: {
            "shape": list(episode[path].shape), "dtype": str(episode[path].dtype), "unit": episode[path].unit,
            "rate_hz": rates.get(path), **_meaning(episode, path),
        }
        for path in episode.paths
    }  # fmt: skip
    return {
        "path": str(episode.extent), "bytes": episode.extent.size, "format_version": episode.format_version,
        "sha256": episode.seal, "steps": len(episode), "seconds": episode.seconds,
        "meta": dataclasses.asdict(episode.meta), "arrays": arrays,
    }  # fmt: skip


def field_facts(episode: EpisodeReader) -> dict[str, dict[str, Any]]:
    """Return what the declarations of all arrays of an episode say, as JSON values by dataset path.

    Args:
        episode: Reader of the episode.
    """
    facts = {}
    for path in episode.paths:
        if field := episode.declarations.at(path):
            known = {"shape": list(field.shape), "dtype": field.dtype, "unit": field.unit}
            facts[path] = known | _meaning(episode, path)
    return facts


def _meaning(episode: EpisodeReader, path: str) -> dict[str, Any]:
    field = episode.declarations.at(path)
    if field is None:
        return {}
    parts = [[part.kind, list(part.index)] for part in field.parts]
    known = {"axes": field.axes, "about": field.about, "components": field.components, "parts": parts}
    return known | {"bounds": field.bounds, "assumed": field.assumed, "doc": field.doc}


def episode_lines(episode: EpisodeReader) -> list[str]:
    """Return a description of an episode in several lines of text.

    Args:
        episode: Reader of the episode.
    """
    meta = episode.meta
    lines = [
        f"  success   {'yes' if meta.success else 'no'}",
        f"  source    {printable(meta.source, 40)}, seed {meta.seed}",
        *(f"  {label:9} {printable(text, 200)}" for name, label in NAMED.items() if (text := getattr(meta, name))),
        f"  software  {printable(software_words(meta.software) or 'unknown')}",
        f"  file      format {episode.format_version}, {size_words(episode.extent.size)}, sha256 {episode.seal[:12]}",
    ]
    fields = [field for path in episode.paths if (field := episode.declarations.at(path)) and meaning(field)]
    lines += [
        f"  meaning   {field.path}: {meaning(field)}" for field in fields if not field.path.startswith("cameras/")
    ]
    declared = {path: declared_hz(meta.config, path.rpartition("/")[0]) for path in episode.rates}
    lines += [f"  declared  {path.rpartition('/')[0]} {rate:g} Hz" for path, rate in declared.items() if rate]
    lines += [f"  transform {printable(record)}" for record in meta.transforms]
    lines += [f"  mark      {_mark_words(one)}" for one in meta.annotations]
    lines += [f"  history   {printable(one.get('time', ''), 40)} {printable(one['tool'])}" for one in meta.history]
    return [*repr(episode).splitlines(), *map(printable, lines)]


def _mark_words(one: dict[str, Any]) -> str:
    return f"{printable(one['name'], 80)} from {one['start_ns'] / 1e9:.3f} to {one['end_ns'] / 1e9:.3f} s"
