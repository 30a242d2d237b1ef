"""Symmetry group experiment, which measures the accuracy and the training time of each group."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from matplotlib.ticker import LogLocator

from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.report import NAMES
from svfl_models.experiments.figures import GROUP_COLOURS, accuracy_label, best_known, panels
from svfl_models.experiments.page import accuracy_words, markdown, tests
from svfl_models.experiments.results import Results
from svfl_models.networks.inputs import ENCODERS
from svfl_models.training.figures import save

TITLE = "Block centering: the size of the symmetry group"
GROUPS = ("none", "C4", "D4", "C8", "D8", "D12")


def cells(base: TrainingConfig, train_samples: Sequence[int]) -> list[TrainingConfig]:
    """Return the configurations of the experiment, all with seed 0.

    Args:
        base: Recipe that the configurations deviate from.
        train_samples: Sizes of the training set.
    """
    return [
        replace(base, encoder=encoder, group=group, train_samples=count)
        for encoder in ENCODERS
        for group in GROUPS
        for count in train_samples
    ]


def body(results: Results) -> str:
    """Return the page between title and recipe, in Markdown: the table of accuracy and training time by group."""
    counts = results.values("train_samples")
    header = ["input", "group", "parameters"]
    for count in counts:
        header += [f"{count} samples, {test}, %" for test in tests(results)] + [f"{count} samples, time, s"]
    rows = []
    for encoder in ENCODERS:
        for group in GROUPS:
            found = results.find(encoder=encoder, group=group)
            parameters = found[0].mean("parameters")
            row = [NAMES[encoder], group, f"{parameters.mean:,.0f}" if parameters else "-"]
            for cell in found:
                row += [accuracy_words(cell, test) for test in tests(results)]
                row.append(f"{cell.seconds.mean:.0f}" if cell.seconds else "-")
            rows.append(row)
    return f"""\
C_N has N rotations, D_N also N reflections; `none` is the CNN baseline whose parameters are matched to
those of D4. All groups have the preset's number of fields: a field has as many channels as the group has elements, so
networks of larger groups are wider. On a pixel grid only quarter turns and reflections are exact (C4, D4); other
rotations are approximate for images and exact for force. Time is that of a training with one thread, mean over the
seeds; it depends on the machine and its load.

{markdown(header, rows)}

![accuracy against training time](groups.png)
"""


def draw(results: Results, folder: Path) -> list[Path]:
    """Write the figure of accuracy against training time, with a point for every cell.

    Args:
        results: Runs of the experiment.
        folder: Folder to write to.

    Returns:
        The file of the figure, in a list.
    """
    counts = results.values("train_samples")
    figure, axes = panels(1, 3, 4.0)
    for panel, encoder in zip(axes, ENCODERS, strict=True):
        for group in GROUPS:
            colour = GROUP_COLOURS[group]
            for cell in results.find(encoder=encoder, group=group):
                accuracy, seconds = best_known(cell, results), cell.seconds
                if accuracy and seconds:
                    most = cell.config.train_samples == counts[-1]
                    panel.errorbar(
                        seconds.mean, accuracy.mean, accuracy.error or 0, seconds.error or 0, fmt="o" if most else "^",
                        color=colour, markerfacecolor=colour if most else "white", markersize=7, elinewidth=1,
                    )  # fmt: skip
        panel.set(title=NAMES[encoder], xlabel="training time, s", xscale="log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.minorticks_off()
        panel.grid(alpha=0.3)
    axes[0].set_ylabel(accuracy_label(results))
    for group in GROUPS:
        axes[0].plot([], [], "o", color=GROUP_COLOURS[group], label=group)
    for count in counts:
        most = count == counts[-1]
        axes[0].plot([], [], "o" if most else "^", color="black", markerfacecolor="black" if most else "white",
                     label=f"{count} training samples")  # fmt: skip
    figure.legend(loc="outside lower center", ncols=len(GROUPS) + len(counts), fontsize=9, columnspacing=1.2)
    return [save(figure, folder / "groups.png")]
