"""The figures of a table of behaviour cloning: success with its intervals, and learning curves."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from svfl_models.experiments.cloning_table import Table
from svfl_models.experiments.figures import MODEL_COLOURS, panels
from svfl_models.experiments.seed_intervals import success_rate
from svfl_models.training import run_folder
from svfl_models.training.figures import save
from svfl_models.training.writing import read_numbers

GROUP_WIDTH = 0.8
"""Width of the bars of one number of demonstrations together, where the distance to the next one is 1."""


def draw_success(table: Table, names: Mapping[str, str], file: Path) -> Path:
    """Draw the success rate of each network by task and number of demonstrations.

    Args:
        table: Runs of the table.
        names: Name of each network in the legend.
        file: PNG file to write.

    Returns:
        The file.
    """
    figure, axes = panels(1, len(table.tasks), 3.4)
    width = GROUP_WIDTH / len(table.networks)
    for panel, task in zip(axes, table.tasks, strict=True):
        for place, network in enumerate(table.networks):
            for position, count in enumerate(table.counts):
                trials = table.success(task, count, network)
                middle = position + width * (place - (len(table.networks) - 1) / 2)
                if trials is not None:
                    _bar(panel, middle, width, trials, MODEL_COLOURS[network])
        panel.set(title=task.replace("_", " "), xlabel="demonstrations", ylim=(0, 100))
        panel.set_xticks(range(len(table.counts)), [str(count) for count in table.counts])
        panel.set_xlim(-0.7, len(table.counts) - 0.3)
        panel.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("success, % (dots: seeds)")
    for network in table.networks:
        axes[0].bar(0, 0, color=MODEL_COLOURS[network], label=names[network])
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(table.networks))
    return save(figure, file)


def _bar(panel: Axes, place: float, width: float, trials: np.ndarray, colour: str) -> None:
    found, seeds = success_rate(trials), trials.mean(axis=1)
    panel.bar(place, 100 * found.value, 0.9 * width, color=colour)
    spread = [[100 * (found.value - found.low)], [100 * (found.high - found.value)]]
    panel.errorbar(place, 100 * found.value, spread, color="black", capsize=3)
    spots = place + np.linspace(-width / 5, width / 5, len(seeds))
    panel.plot(spots, 100 * seeds, "o", color="white", markeredgecolor="black", markersize=4)


def draw_curves(table: Table, names: Mapping[str, str], file: Path) -> Path:
    """Draw the loss by epoch, for the demonstrations that are learned from and for those that are held out.

    Args:
        table: Runs of the table.
        names: Name of each network in the legend.
        file: PNG file to write.

    Returns:
        The file.
    """
    figure, axes = panels(1, len(table.tasks), 3.4)
    for panel, task in zip(axes, table.tasks, strict=True):
        for network in table.networks:
            curves = [_metrics(run.folder) for run, _ in table.find(task, table.counts[-1], network)]
            for name, style, words in (("train_loss", ":", "learned from"), ("valid_loss", "-", "held out")):
                if curves:
                    mean = np.mean([curve[name] for curve in curves], axis=0)
                    label = f"{names[network]}, {words}"
                    panel.plot(1 + np.arange(len(mean)), mean, style, color=MODEL_COLOURS[network], label=label)
        panel.set(title=task.replace("_", " "), xlabel="epoch", yscale="log")
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("loss")
    if axes[0].get_legend_handles_labels()[0]:
        axes[0].legend(fontsize=8)
    return save(figure, file)


def _metrics(folder: Path) -> dict[str, list[float]]:
    rows = read_numbers(folder / run_folder.METRICS)
    return {name: [row[name] for row in rows] for name in ("train_loss", "valid_loss")}
