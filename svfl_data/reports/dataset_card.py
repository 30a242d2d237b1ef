"""A dataset card: a Markdown description of the content of a dataset, with pictures in a folder beside the card."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import identity
from svfl_data.datasets.index import Summary, entries, summary
from svfl_data.errors import DatasetError, StorageError
from svfl_data.reports import plot
from svfl_data.sampling.split import FOLDER as SPLITS
from svfl_data.schema.episode import Episode
from svfl_data.schema.field_words import camera_pose, meaning
from svfl_data.signals.transforms import processed_wrench
from svfl_data.storage.reader import EpisodeReader
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import markdown
from svfl_data.system.progress import progress
from svfl_data.system.regular_file import refuse_link

PICTURES = "{stem}_files"
"""Name of the folder of the pictures, beside the card; ``{stem}`` is the card's file name without its suffix."""


@dataclass(frozen=True)
class Facts:
    """Facts about one episode that the card summarises.

    Attributes:
        index: Index of the episode.
        success: Whether the task was achieved.
        seconds: Time from the first to the last observation, [s].
        peak_n: Largest norm of the force after the recorded transforms, from the first observation on, [N]. None
            if the episode has no ``streams/wrench``.
        direction: Label of the episode, an index into `svfl_data.symmetry.DIRECTIONS`; -1 if it has no label.
        annotations: Name of each annotation of the episode.
        findings: Severity of each finding of the checks of ``svfl-data validate``.
    """

    index: int
    success: bool
    seconds: float
    peak_n: float | None
    direction: int
    annotations: tuple[str, ...]
    findings: tuple[str, ...]


def write_card(dataset: Dataset, out: Path) -> list[Path]:
    """Write the card of a dataset and its pictures.

    Args:
        dataset: Dataset to describe. All of its episodes are read.
        out: Markdown file to write; replaced if it exists.

    Returns:
        The files that were written; the card is the last one.

    Raises:
        DatasetError: If the dataset has no episode, or an episode is damaged.
        FormatError: If the file or the folder of the pictures is a link, or a recorded transform is unknown.
        StorageError: If a file cannot be written.
    """
    found = entries(dataset)
    for entry in found:
        if entry.error:
            raise DatasetError(f"{entry.error}; see svfl-data validate and svfl-data repair")
    if not found:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    facts = [episode_facts(dataset.read(entry.index)) for entry in progress(found, "reading episodes")]
    folder = out.parent / PICTURES.format(stem=out.stem)
    refuse_link(folder)
    refuse_link(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"cannot create {folder}: {error.strerror}") from error
    typical = sorted(facts, key=lambda fact: fact.seconds)[len(facts) // 2]
    pictures = [folder / "episode.png", folder / "distributions.png"]
    plot.save(dataset.read(typical.index), pictures[0])
    write_atomically(pictures[1], plot.png(distributions(facts)))
    beside = [picture.relative_to(out.parent).as_posix() for picture in pictures]
    write_atomically(out, card(dataset, summary(dataset), facts, typical.index, beside).encode())
    return [*pictures, out]


def episode_facts(episode: Episode) -> Facts:
    """Collect the facts about an episode that the card summarises.

    Args:
        episode: Episode to describe, which is also checked as ``svfl-data validate`` does.
    """
    force = np.zeros(0)
    if episode.has("wrench"):
        after = episode.wrench_t_ns >= episode.t_ns[0]
        force = np.linalg.norm(processed_wrench(episode)[after, :3].astype(np.float64), axis=1)
    return Facts(
        episode.meta.index,
        episode.meta.success,
        float(episode.t_ns[-1] - episode.t_ns[0]) / 1e9,
        float(force.max(initial=0.0)) if episode.has("wrench") else None,
        int(episode.label_direction) if episode.has("label_direction") else -1,
        tuple(str(one.get("name")) for one in episode.meta.annotations if isinstance(one, dict)),
        tuple(finding.severity for finding in check_episode(episode)),
    )


def distributions(facts: Sequence[Facts]) -> Figure:
    """Draw histograms of the episodes: duration, and largest force and labels of those that have a wrench or a label.

    Args:
        facts: Facts about the episodes, at least one.
    """
    figure = Figure(figsize=(11, 2.8), layout="constrained")
    labelled = "labels" in _drawn(facts)
    felt = [fact for fact in facts if fact.peak_n is not None]
    axes = np.atleast_1d(figure.subplots(1, 1 + bool(felt) + labelled))
    _histogram(axes[0], facts, "seconds", "duration, s")
    axes[0].legend(fontsize=8, frameon=False)
    if felt:
        _histogram(axes[1], felt, "peak_n", "largest force, N")
    if labelled:
        counts = [sum(fact.direction == number for fact in facts) for number in range(len(DIRECTIONS))]
        axes[-1].bar(DIRECTIONS, counts, color=plot.GREY)
        axes[-1].set_xlabel("label: direction in the image")
    for axis in axes:
        axis.set_ylabel("episodes")
        axis.spines[["top", "right"]].set_visible(False)
    return figure


def _drawn(facts: Sequence[Facts]) -> list[str]:
    """Return what the histograms of the episodes show."""
    known = {
        "duration": True,
        "largest force": any(fact.peak_n is not None for fact in facts),
        "labels": any(fact.direction >= 0 for fact in facts),
    }
    return [name for name, is_known in known.items() if is_known]


def _histogram(axis: Axes, facts: Sequence[Facts], name: str, label: str) -> None:
    """Draw a histogram with failures stacked on successes; failures are hatched, to be visible without colour."""
    values = [[getattr(fact, name) for fact in facts if fact.success == success] for success in (True, False)]
    everything = values[0] + values[1]
    span = (min(everything), max(everything)) if min(everything) < max(everything) else None
    edges = np.histogram_bin_edges(everything, bins=20, range=span)
    success, failure = (np.histogram(chosen, edges)[0] for chosen in values)
    width = np.diff(edges)
    axis.bar(edges[:-1], success, width, align="edge", color=plot.Z, label="success")
    if failure.any():
        axis.bar(edges[:-1], failure, width, success, align="edge", color=plot.X, hatch="//", label="no success")
    axis.set_xlabel(label)


def card(dataset: Dataset, found: Summary, facts: Sequence[Facts], shown: int, pictures: Sequence[str]) -> str:
    """Return the Markdown text of the card.

    Args:
        dataset: Dataset to describe.
        found: Summary of the dataset.
        facts: Facts about its episodes.
        shown: Index of the episode that the first picture shows.
        pictures: Paths of the two pictures relative to the card: the episode, then the histograms.
    """
    name = dataset.path.resolve().name
    first = dataset.episode(dataset.indices[0])
    lines = [
        f"# {markdown(name)}",
        "",
        f"{_counted(found.episodes, 'episode')} of {' and '.join(map(markdown, found.tasks))}: "
        f"{_counted(found.steps, 'step')}, {found.seconds / 60:.3g} minutes, {found.bytes / 1e6:.3g} MB. "
        f"Source: {_listed(found.sources)}.",
        *(["", f"Instruction: {_listed(found.instructions)}."] if found.instructions else []),
        *(["", f"Robot: {_listed(found.robots)}."] if found.robots else []),
        "",
        "| | |",
        "| --- | --- |",
        *(f"| {key} | {value} |" for key, value in _figures(dataset, found, facts)),
        "",
        "## Streams",
        "",
        "| stream | rate, Hz | rows | what |",
        "| --- | --- | --- | --- |",
        *_streams(found, first),
        "",
        *_about_streams(found, first),
        "## Distributions",
        "",
        f"![Histograms of {' and '.join(_drawn(facts))}]({quote(pictures[1])})",
        "",
        f"## Episode {shown}, of median duration",
        "",
        f"![Episode {shown} over time]({quote(pictures[0])})",
        "",
        "## How to read it",
        "",
        "```python",
        "from svfl_data.datasets.dataset import Dataset",
        "",
        f"dataset = Dataset.open({json.dumps(name)})",
        f"episode = dataset.read({shown})",
        "print(episode)",
        "```",
        "",
        *_origins(dataset.info.get("config", {})),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _figures(dataset: Dataset, found: Summary, facts: Sequence[Facts]) -> Iterator[tuple[str, str]]:
    peaks = [fact.peak_n for fact in facts if fact.peak_n is not None]
    yield "success", f"{found.successes} of {found.episodes} ({found.successes / found.episodes:.1%})"
    yield "duration of an episode", f"{_range([fact.seconds for fact in facts])} s"
    if peaks:
        yield "largest force of an episode", f"{_range(peaks)} N"
    if marks := Counter(name for fact in facts for name in fact.annotations):
        yield "annotations", _listed(marks)
    if any(fact.direction >= 0 for fact in facts):
        labels = Counter(DIRECTIONS[fact.direction] for fact in facts if 0 <= fact.direction < len(DIRECTIONS))
        yield "labels", _listed(labels)
    kinds = Counter(severity for fact in facts for severity in fact.findings)
    yield "svfl-data validate", f"{_counted(kinds['error'], 'error')}, {_counted(kinds['warning'], 'warning')}"
    splits = sorted(file.stem for file in (dataset.path / SPLITS).glob("*.json") if "." not in file.stem)
    yield "splits", ", ".join(map(markdown, splits)) or "none"
    yield "seed", markdown(dataset.info.get("seed"))
    yield "identity (SHA-256 over the seals)", str(identity(dataset))
    yield "format", _listed(found.format_versions)
    yield "software", _listed(found.recorded_with) if found.recorded_with else "unknown"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.3g} to {max(values):.3g} (median {float(np.median(values)):.3g})"


def _listed(counts: dict[str, int] | Counter[str]) -> str:
    return ", ".join(f"{markdown(name)} ({count})" for name, count in counts.items()) or "-"


def _streams(found: Summary, first: EpisodeReader) -> Iterator[str]:
    for name, stream in found.streams.items():
        yield f"| {markdown(name)} | {_rate(stream)} | {stream['rows']} | {_arrays(f'streams/{name}', first)} |"
    for name, camera in found.cameras.items():
        sizes = " and ".join(f"{height} x {width} px" for height, width in camera["sizes"])
        where = camera_pose(name, first.paths)
        place = f", {where}" if where else ""
        yield f"| camera {markdown(name)} | {_rate(camera)} | {camera['rows']} | {sizes}{place} |"
    for group, rows in (("observations", found.steps + found.episodes), ("actions", found.steps), ("labels", None)):
        if what := _arrays(group, first):
            yield f"| {group} | {'each step' if rows else 'once'} | {rows or found.episodes} | {what} |"


def _about_streams(found: Summary, first: EpisodeReader) -> list[str]:
    """Return how to read the streams that the episodes have; nothing without streams."""
    words = ["Each stream has its own timestamps."] if found.streams else []
    if "streams/wrench/tare" in first:
        words.append("Wrench readings are raw: subtract the tare, or apply the recorded transforms.")
    return [" ".join(words), ""] if words else []


def _arrays(group: str, first: EpisodeReader) -> str:
    """Return the arrays of a group with their units and what else their declarations say."""
    said = []
    for field in first.declarations.in_group(group):
        if field.path in first and not field.path.endswith("/t_ns"):
            more = f", {markdown(meaning(field))}" if meaning(field) else ""
            said.append(f"{markdown(field.path.rpartition('/')[2])} [{markdown(field.unit)}]{more}")
    return "; ".join(said)


def _rate(stream: dict[str, Any]) -> str:
    low, high = stream["rate_hz"] or (0.0, 0.0)
    return "-" if not high else f"{low:.4g}" if f"{low:.4g}" == f"{high:.4g}" else f"{low:.4g} to {high:.4g}"


def _origins(config: dict[str, Any]) -> list[str]:
    """Return the lines about the source datasets of a merged or filtered dataset; none for other datasets."""
    if "sources" not in config:
        return []
    conditions = f", keeping {' and '.join(map(markdown, config['conditions']))}" if "conditions" in config else ""
    origins = [
        f"- {markdown(one.get('dataset'))}: {markdown(one.get('task'))}, seed {markdown(one.get('seed'))}"
        for one in config["sources"]
    ]
    return ["## Where it came from", "", f"{markdown(config.get('made_by'))}{conditions}, from", "", *origins]
