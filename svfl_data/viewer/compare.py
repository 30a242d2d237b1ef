"""Comparison of two datasets by the magnitudes of their forces and torques."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.system.printable import markdown, printable
from svfl_data.system.progress import progress
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_data.viewer.entities.names import AXES, FORCE
from svfl_data.viewer.recording import RULE

BINS = 40
SHOWN = 0.995
"""Share of the readings that the range of the histograms covers; larger values count in the last bin."""
COLORS = (FORCE, AXES[2])
QUANTILES = (0.5, 0.95, 0.99, 1.0)


@dataclass(frozen=True, eq=False)
class Loads:
    """Magnitudes of the processed wrenches of a dataset.

    Attributes:
        name: Path of the dataset.
        force: Norm of the force of every reading, shape (M,), [N].
        torque: Norm of the torque of every reading, shape (M,), [N m].
        peak: Largest norm of the filtered force of every episode, shape (E,), [N].
    """

    name: str
    force: np.ndarray
    torque: np.ndarray
    peak: np.ndarray

    @classmethod
    def of(cls, dataset: Dataset) -> "Loads":
        """Read the wrenches of a dataset.

        Args:
            dataset: Dataset whose episodes are all read.

        Raises:
            DatasetError: If the dataset has no wrench readings.
        """
        norms, peaks = [], []
        for index in progress(dataset.indices, printable(f"forces of {dataset.path}")):
            pieces = list(EpisodeSource.of(dataset.episode(index)).readings(RULE))
            norms += [np.linalg.norm(piece.wrench.reshape(-1, 2, 3), axis=2) for piece in pieces]
            peaks.append(max((float(piece.size.max()) for piece in pieces), default=0.0))
        if not norms:
            raise DatasetError(f"{dataset.path}: no wrench readings to compare")
        force, torque = np.concatenate(norms).T
        return cls(str(dataset.path), force, torque, np.array(peaks))


def content(first: Dataset, second: Dataset) -> Callable[[rr.RecordingStream], None]:
    """Prepare the comparison of two datasets to be shown.

    Args:
        first: First dataset.
        second: Second dataset.

    Returns:
        Function that logs the comparison and the layout of the window to a recording.

    Raises:
        DatasetError: If a dataset has no wrench readings.
    """
    loads = (Loads.of(first), Loads.of(second))

    def log(recording: rr.RecordingStream) -> None:
        recording.send_recording_name(printable(f"forces: {loads[0].name} and {loads[1].name}"))
        views = []
        for path, words, values in (
            ("force", "Force of a reading, N", [load.force for load in loads]),
            ("torque", "Torque of a reading, N m", [load.torque for load in loads]),
            ("peak", "Largest filtered force of an episode, N", [load.peak for load in loads]),
        ):
            edges = bins(values)
            for number, sizes in enumerate(values):
                width = np.diff(edges)
                bars = rr.BarChart(
                    shares(sizes, edges), abscissa=edges[:-1] + width / 2, widths=0.8 * width, color=COLORS[number]
                )
                recording.log(f"compare/{path}/{'ab'[number]}", bars, static=True)
            views.append(
                [
                    rrb.BarChartView(origin=f"compare/{path}/{'ab'[number]}", name=printable(f"{words}: {load.name}"))
                    for number, load in enumerate(loads)
                ]
            )
        text = rr.TextDocument(table(loads), media_type=rr.MediaType.MARKDOWN)
        recording.log("compare/table", text, static=True)
        rows = [rrb.Horizontal(*pair) for pair in views]
        document = rrb.TextDocumentView(origin="compare/table", name="Numbers")
        recording.send_blueprint(
            rrb.Blueprint(
                rrb.Vertical(*rows, document, row_shares=[3, 3, 3, 3]),
                rrb.BlueprintPanel(state="hidden"), rrb.SelectionPanel(state="hidden"), rrb.TimePanel(state="hidden"),
            )
        )  # fmt: skip

    return log


def bins(values: list[np.ndarray]) -> np.ndarray:
    """Return the common edges of the bins of histograms that are compared, from 0, shape (`BINS` + 1,).

    Args:
        values: Non-negative values of each histogram. The edges reach the largest of their `SHOWN` quantiles.
    """
    top = max(float(np.quantile(sizes, SHOWN)) for sizes in values)
    return np.linspace(0.0, top or 1.0, BINS + 1)


def shares(sizes: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the percentage of the values in each bin, shape (`BINS`,).

    Args:
        sizes: Non-negative values. Values beyond the last edge count in the last bin.
        edges: Edges of the bins, shape (`BINS` + 1,).
    """
    counts, _ = np.histogram(np.minimum(sizes, edges[-1]), edges)
    return 100 * counts / max(1, len(sizes))


def distance(first: np.ndarray, second: np.ndarray) -> float:
    """Return the largest difference between the cumulative distributions of two samples.

    Args:
        first: Values of the first sample, shape (M,).
        second: Values of the second sample, shape (N,).

    Returns:
        A number from 0 (equal distributions) to 1 (distributions that do not overlap).

    Source: the statistic of the two-sample test of Smirnov, Ann. Math. Statist. 19 (1948), p. 279.
    """
    both = np.sort(np.concatenate([first, second]))
    below = [np.searchsorted(np.sort(sizes), both, side="right") / len(sizes) for sizes in (first, second)]
    return float(np.abs(below[0] - below[1]).max())


def table(loads: tuple[Loads, Loads]) -> str:
    """Return a Markdown table with the quantiles of the magnitudes of two datasets, and their largest differences.

    Args:
        loads: Magnitudes of the two datasets.
    """
    heads = [f"{name} %" if share < 1 else "largest" for share, name in zip(QUANTILES, (50, 95, 99, 100), strict=True)]
    lines = [
        f"| dataset | episodes | readings | force, N: {' | '.join(heads)} | torque, N m: {' | '.join(heads)} |",
        "|" + " --- |" * (3 + 2 * len(QUANTILES)),
    ]
    for load in loads:
        force = " | ".join(f"{value:.1f}" for value in np.quantile(load.force, QUANTILES))
        torque = " | ".join(f"{value:.2f}" for value in np.quantile(load.torque, QUANTILES))
        lines.append(f"| {markdown(load.name)} | {len(load.peak)} | {len(load.force)} | {force} | {torque} |")
    first, second = loads
    lines += [
        "",
        "Bars: percent of the readings, or of the episodes; the last bar holds everything larger. Largest difference "
        f"between the cumulative distributions: force {distance(first.force, second.force):.2f}, "
        f"torque {distance(first.torque, second.torque):.2f}, largest force {distance(first.peak, second.peak):.2f} "
        "(0 equal, 1 separate).",
    ]
    return "\n".join(lines)
