"""Experiment of the paper's table: accuracy by input, network and number of training samples."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.paper_figures import centering_figure
from svfl_models.centering.report import NAMES
from svfl_models.experiments import error_analysis
from svfl_models.experiments.figures import (
    MODEL_COLOURS,
    accuracy_label,
    best_known,
    few_ticks,
    legend,
    line,
    panels,
)
from svfl_models.experiments.page import MODELS, accuracy_words, markdown, tests
from svfl_models.experiments.results import NOTHING, Cell, Mean, Results
from svfl_models.networks.inputs import ENCODERS
from svfl_models.training.figures import save

TITLE = "Block centering: input and symmetry against training samples"
Lines = dict[tuple[str, str], dict[int, Mean | None]]
"""Accuracies in per cent by (encoder, model) and then by the number of training samples."""


def cells(base: TrainingConfig, train_samples: Sequence[int]) -> list[TrainingConfig]:
    """Return the configurations of the experiment, all with seed 0.

    Args:
        base: Recipe that the configurations deviate from.
        train_samples: Sizes of the training set.
    """
    return [
        replace(base, encoder=encoder, group=group, train_samples=count)
        for encoder in ENCODERS
        for group in MODELS.values()
        for count in train_samples
    ]


def body(results: Results) -> str:
    """Return the page between title and recipe, in Markdown: the table with the paper's figures, and the errors."""
    counts = results.values("train_samples")
    rows = []
    for encoder in ENCODERS:
        for model, group in MODELS.items():
            found = results.find(encoder=encoder, group=group)
            name = [NAMES[encoder], NAMES[model]]
            for test in tests(results):
                rows.append([*name, f"ours, {test}", *(_ours(cell, test) for cell in found)])
                name = ["", ""]
            rows.append(["", "", "paper", *(str(_paper(cell) or NOTHING) for cell in found)])
    return f"""\
V is the image, F the last {results.cells[0].config.window} wrench readings. SVFL is symmetric under D4, CNN is its
parameter-matched CNN baseline{_parameters(results)}. The paper is Kohler et al., CoRL 2023, block centering in
simulation, 3 seeds, 100 test samples; its data are not published, so its figures are of the same task, not of the
same samples.

{markdown(["input", "network", "accuracy, %", *(f"{count} samples" for count in counts)], rows)}

{_against_paper(results)}

![accuracy against training samples](table.png)

{error_analysis.section(hardest(results), "table_errors.png")}"""


def _parameters(results: Results) -> str:
    """Return the measured numbers of parameters in words, as far as they are known."""
    words = []
    for encoder in ENCODERS:
        counts = [results.find(encoder=encoder, group=group)[0].mean("parameters") for group in MODELS.values()]
        if all(counts):
            words.append(f"{NAMES[encoder]} " + " and ".join(f"{count.mean:,.0f}" for count in counts if count))
    return f" (parameters of SVFL and CNN: {'; '.join(words)})" if words else ""


def draw(results: Results, folder: Path) -> list[Path]:
    """Write the figures of accuracy by training samples and of the errors.

    Args:
        results: Runs of the experiment.
        folder: Folder to write to.

    Returns:
        The files of both figures.
    """
    lines = {
        (encoder, model): {
            cell.config.train_samples: best_known(cell, results) for cell in results.find(encoder=encoder, group=group)
        }
        for encoder in ENCODERS
        for model, group in MODELS.items()
    }
    figure = accuracy_figure(lines, accuracy_label(results))
    return [save(figure, folder / "table.png"), error_analysis.draw(hardest(results), folder / "table_errors.png")]


def accuracy_figure(lines: Lines, label: str) -> Figure:
    """Return the figure of accuracy by training samples, ours beside the paper's.

    Args:
        lines: Our accuracies, of the same numbers of training samples in every line.
        label: Label of the axis that shows them.
    """
    counts = list(next(iter(lines.values())))
    figure, axes = panels(1, 3, 3.7)
    for panel, encoder in zip(axes, ENCODERS, strict=True):
        for model in MODELS:
            ours = lines[encoder, model]
            published = [_published(encoder, model, count) for count in counts]
            style = {"color": MODEL_COLOURS[model], "markersize": 4}
            line(panel, counts, [ours[count] for count in counts], fmt="o-", label=f"ours, {NAMES[model]}", **style)
            line(panel, counts, published, fmt="s--", alpha=0.5, label=f"paper, {NAMES[model]}", **style)
        panel.axhline(25, color="grey", linewidth=0.8, linestyle=":")
        panel.set(title=NAMES[encoder], xlabel="training samples", xscale="log", ylim=(20, 102))
        few_ticks(panel, counts)
    axes[0].set_ylabel(label)
    axes[0].text(counts[-1], 26, "chance", color="grey", ha="right", fontsize=8)
    legend(axes[1], "lower right")
    return figure


def hardest(results: Results) -> list[Cell]:
    """Return the cells of the symmetric networks with the most training samples, whose errors are analysed.

    Their errors are those that remain with the largest training set.
    """
    return results.find(group=MODELS["svfl"], train_samples=max(results.values("train_samples")))


def reaches(cell: Cell, ours: Mean | None) -> bool | None:
    """Return whether an accuracy is at or above the paper's, rounded to the digit that the paper prints.

    Args:
        cell: Cell whose figure in the paper is compared.
        ours: Accuracy that we measured, [%].

    Returns:
        Whether it is, or None if one of the two accuracies is missing.
    """
    published = _paper(cell)
    return None if ours is None or published is None else round(ours.mean, 1) >= published.mean


def _published(encoder: str, model: str, train_samples: int) -> Mean | None:
    figure = centering_figure(encoder, model, train_samples)
    return Mean(*figure, count=3) if figure else None


def _paper(cell: Cell) -> Mean | None:
    return _published(cell.config.encoder, cell.config.model, cell.config.train_samples)


def _ours(cell: Cell, test: str) -> str:
    words = accuracy_words(cell, test)
    good = reaches(cell, cell.on(test))
    return f"**{words}**" if good and cell.config.model == "svfl" else words


def _against_paper(results: Results) -> str:
    """Return a text that says how many of the SVFL cells reach the paper's accuracy."""
    symmetric = results.find(group=MODELS["svfl"])
    if not any(map(_paper, symmetric)):
        return "The paper has no such cells."
    sentences = []
    for test in tests(results):
        reached = [(cell, reaches(cell, cell.on(test))) for cell in symmetric]
        known = [good for _, good in reached if good is not None]
        if not known:
            continue
        below = [f"{NAMES[cell.config.encoder]} {cell.config.train_samples}" for cell, good in reached if good is False]
        sentences.append(
            f"On the {test} {sum(known)} of {len(known)} SVFL cells are at or above the paper's"
            + (f" (below: {', '.join(below)})." if below else ".")
        )
    if not sentences:
        return "No SVFL network that the paper has a figure of is finished yet."
    return f"Bold: SVFL at or above the paper's SVFL. {' '.join(sentences)}"
