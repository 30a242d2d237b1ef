"""``svfl-data info``: what a dataset or an episode holds."""

import argparse
import dataclasses
from typing import Any

from svfl_data.cli import Commands
from svfl_data.clocks import declared_hz
from svfl_data.dataset import Dataset
from svfl_data.fields import FIELDS
from svfl_data.index import Summary, summary
from svfl_data.reader import EpisodeReader
from svfl_data.verbs.source import add_episode, add_json, add_path, is_episode, print_json, reader

SECONDS_PER_HOUR = 3600


def add(commands: Commands) -> None:
    """Put the verb on the command line."""
    verb = commands.add_parser(
        "info",
        help="what it holds: episodes, steps, hours, tasks, streams with rate and unit, size",
        description="What a dataset holds: episodes, steps, hours, tasks, success rate, sources, streams with rate and "
        "unit, cameras with size and rate, bytes, versions. With --episode, one episode in detail.",
        example="svfl-data info data/centering\nsvfl-data info data/centering --episode 3 --json",
    )
    add_path(verb)
    add_episode(verb, otherwise="the whole dataset")
    add_json(verb)
    verb.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Print the figures."""
    if is_episode(arguments.path) or arguments.episode is not None:
        episode = reader(arguments.path, arguments.episode)
        print_json(episode_facts(episode)) if arguments.json else print(episode_words(episode))
        return
    dataset = Dataset.open(arguments.path)
    found = summary(dataset)
    software = dataset.episode(dataset.indices[0]).meta.software if found.episodes and not found.damaged else {}
    if arguments.json:
        print_json({"path": str(dataset.path), "info": dataset.info, "software": software, **dataclasses.asdict(found)})
    else:
        print(dataset_words(dataset, found, software))


def units(group: str) -> str:
    """Units of a stream's or camera's arrays, from their declarations, e.g. ``N, N m`` for ``streams/wrench``."""
    declared = [
        field.unit for field in FIELDS if field.path.startswith(f"{group}/") and not field.path.endswith("t_ns")
    ]
    single = [unit for unit in declared[0].split(", ") if unit != "-"] if declared else []
    return ", ".join(dict.fromkeys(single)) or "-"


def dataset_words(dataset: Dataset, found: Summary, software: dict[str, str]) -> str:
    """A dataset in a few lines, for a person."""
    rate = f"{found.successes / found.episodes:.1%}" if found.episodes else "-"
    versions = ", ".join(f"{name} {version}" for name, version in software.items()) or "unknown"
    formats = ", ".join(f"{name} ({count})" for name, count in found.format_versions.items()) or "-"
    lines = [
        f"{dataset.path}: {found.episodes} episodes, {found.steps} steps, "
        f"{found.seconds / SECONDS_PER_HOUR:.3g} hours, {size_words(found.bytes)}",
        f"  tasks     {_counts(found.tasks)}",
        f"  sources   {_counts(found.sources)}",
        f"  success   {found.successes} of {found.episodes} ({rate})",
    ]
    for name, stream in found.streams.items():
        lines.append(f"  stream    {name}: {_rates(stream)}, {stream['rows']} readings, [{units(f'streams/{name}')}]")
    for name, camera in found.cameras.items():
        sizes = " and ".join(f"{height} x {width} px" for height, width in camera["sizes"])
        lines.append(f"  camera    {name}: {sizes}, {_rates(camera)}, {camera['rows']} frames")
    lines += [
        f"  format    {formats}",
        f"  software  {versions}",
        *(f"  damaged   {reason}" for reason in found.damaged.values()),
    ]
    return "\n".join(lines)


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in counts.items()) or "-"


def _rates(stream: dict[str, Any]) -> str:
    if stream["rate_hz"] is None:
        return "no rate"
    low, high = stream["rate_hz"]
    return f"{low:.4g} Hz" if f"{low:.4g}" == f"{high:.4g}" else f"{low:.4g} to {high:.4g} Hz"


def size_words(size: int) -> str:
    """A number of bytes, for a person."""
    value, unit = float(size), "bytes"
    for larger in ("kB", "MB", "GB", "TB"):
        if value < 1000:
            break
        value, unit = value / 1000, larger
    return f"{value:.3g} {unit}"


def episode_facts(episode: EpisodeReader) -> dict[str, Any]:
    """An episode as JSON values."""
    rates = episode.rates
    arrays = {
        path: {
            "shape": list(episode[path].shape), "dtype": str(episode[path].dtype), "unit": episode[path].unit,
            "rate_hz": rates.get(path),
        }
        for path in episode.paths
    }  # fmt: skip
    return {
        "path": str(episode.extent), "bytes": episode.extent.size, "format_version": episode.format_version,
        "sha256": episode.seal, "steps": len(episode), "seconds": episode.seconds,
        "meta": dataclasses.asdict(episode.meta), "arrays": arrays,
    }  # fmt: skip


def episode_words(episode: EpisodeReader) -> str:
    """An episode in some lines, for a person."""
    meta = episode.meta
    lines = [
        f"  success   {'yes' if meta.success else 'no'}",
        f"  source    {meta.source}, seed {meta.seed}",
        f"  software  {', '.join(f'{name} {version}' for name, version in meta.software.items()) or 'unknown'}",
        f"  file      format {episode.format_version}, {size_words(episode.extent.size)}, sha256 {episode.seal[:12]}",
    ]
    declared = {path: declared_hz(meta.config, path.rpartition("/")[0]) for path in episode.rates}
    lines += [f"  declared  {path.rpartition('/')[0]} {rate:g} Hz" for path, rate in declared.items() if rate]
    lines += [f"  transform {record}" for record in meta.transforms]
    lines += [f"  mark      {_mark_words(one)}" for one in meta.annotations]
    lines += [f"  history   {entry.get('time', '')} {entry.get('tool', entry)}" for entry in meta.history]
    return "\n".join([repr(episode), *lines])


def _mark_words(one: dict[str, Any]) -> str:
    """An annotation; as it stands if it is not what it should be, which `svfl-data validate` says."""
    try:
        return f"{one['name']} from {one['start_ns'] / 1e9:.3f} to {one['end_ns'] / 1e9:.3f} s"
    except (KeyError, TypeError):
        return str(one)
