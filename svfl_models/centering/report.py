"""Writes the results of a training run: two figures, a Markdown page and the numbers as JSON."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.printable import markdown
from svfl_models.centering.config import Latent, TrainingConfig
from svfl_models.centering.paper_figures import centering_figure, centering_words
from svfl_models.training import run_folder
from svfl_models.training.progress import History
from svfl_models.training.provenance import words
from svfl_models.training.provenance.session import Session
from svfl_models.training.run_report import Panel, plot_curves, settings_table
from svfl_models.training.writing import write_figure, write_json, write_text

NAMES = {
    "v": "V", "f": "F", "vf": "V+F", "vfp": "V+F+P", "svfl": "SVFL", "cnn": "CNN",
    "vtt": "VTT", "poe": "PoE", "concat": "concat",
    "frozen": "frozen", "fine-tuned": "fine-tuned", "from-scratch": "from scratch",
}  # fmt: skip
STAGES = ("train", "test")
CURVES = (
    Panel("cross-entropy", {f"{stage}_loss": stage for stage in STAGES}, log=True),
    Panel("accuracy, %", {f"{stage}_accuracy": stage for stage in STAGES}, factor=100, ylim=(0, 102)),
)


@dataclass(frozen=True)
class Result:
    """Outcome of a training run.

    Attributes:
        test_accuracy: Accuracy of the final weights on the test samples, 0..1. It is the headline, because no weights
            are chosen by it.
        best_test_accuracy: Highest test accuracy of all epochs, 0..1. It is optimistic, as a maximum over noisy
            measurements.
        separate_test_accuracy: Accuracy on the samples of another dataset, 0..1; None if there was no other dataset.
        offset_error_mm: Mean distance between predicted and true offset on the test samples, [mm]; None if the network
            predicts directions.
        epochs: Number of epochs trained.
        seconds: Duration of the training without imports and loading, [s].
        parameters: Number of trained parameters of the network.
        train_samples: Number of training samples of each class, in the order of `DIRECTIONS`.
        confusion: Number of test samples by true (row) and predicted (column) direction.
    """

    test_accuracy: float
    best_test_accuracy: float
    separate_test_accuracy: float | None
    offset_error_mm: float | None
    epochs: int
    seconds: float
    parameters: int
    train_samples: list[int]
    confusion: list[list[int]]


def cell_name(config: TrainingConfig) -> str:
    """Return the name of a run's cell in the paper's table, such as ``V+F SVFL, 100 training samples``."""
    group = "" if config.group in ("D4", "none") else f" ({config.group})"
    network = latent_name(config.latent) if config.latent else f"{NAMES[config.model]}{group}"
    return f"{NAMES[config.encoder]} {network}, {config.train_samples} training samples"


def latent_name(latent: Latent) -> str:
    """Return the name of a pretrained encoder with its use, such as ``PoE fine-tuned``."""
    return f"{NAMES[latent.model]} {NAMES[latent.use]}"


def pretraining(latent: Latent) -> str:
    """Return the number of steps, the dataset and the preset of a pretraining in words."""
    return f"{latent.steps:,} steps on {markdown(latent.data)}, preset {markdown(latent.preset)}"


def write_report(
    out: Path,
    config: TrainingConfig,
    result: Result,
    history: History,
    sessions: Sequence[Session] = (),
    hardware: dict[str, Any] | None = None,
) -> None:
    """Write the figures, the page and the numbers of a run into its folder.

    Args:
        out: Folder of the run.
        config: Configuration of the run.
        result: Outcome of the run.
        history: Loss and accuracy of each epoch.
        sessions: Provenance of the run.
        hardware: Devices, number format and threads that the training used, as plain values.
    """
    plot_curves(history, CURVES, out / run_folder.LEARNING_CURVE, cell_name(config))
    plot_confusion(np.array(result.confusion), out / run_folder.CONFUSION, cell_name(config))
    write_text(out / run_folder.REPORT, page(config, result, sessions))
    figure = centering_figure(config.encoder, config.model, config.train_samples)
    numbers = {"config": config.plain(), "result": asdict(result), "paper_accuracy_percent": figure}
    numbers |= {"hardware": hardware} if hardware else {}
    write_json(out / run_folder.RESULT, numbers)


def page(config: TrainingConfig, result: Result, sessions: Sequence[Session] = ()) -> str:
    """Return the report of a run in Markdown."""
    provenance = "".join(f"\n{words.section(one)}" for one in sessions)
    return f"""# Block centering: {cell_name(config)}

| | accuracy |
| --- | --- |
| **{config.test_samples} test samples, final weights** | **{result.test_accuracy:.1%}** |
| the same, best of the tested epochs | {result.best_test_accuracy:.1%} |
{_separate(result)}{_paper(config)}
{_stopping(config, result)} The best epoch is chosen on the test samples and is optimistic; the headline is the
accuracy of the weights that the training ended with.{_same_task(config)}

{_latent(config)}{result.parameters:,} parameters, {result.epochs} epochs, {result.seconds:.0f} s of training on \
{_classes(result)}.
{_offsets(result)}

![learning curve]({run_folder.LEARNING_CURVE})
![confusion matrix]({run_folder.CONFUSION})

{settings_table(_settings(config))}{provenance}"""


def _settings(config: TrainingConfig) -> dict[str, Any]:
    plain = config.plain()
    latent = plain.pop("latent", {})
    return plain | {f"latent {name}": value for name, value in latent.items()}


def _latent(config: TrainingConfig) -> str:
    if config.latent is None:
        return ""
    checkpoint = f"{markdown(config.latent.checkpoint)} (SHA-256 {config.latent.sha256[:12]})"
    if config.latent.use == "from-scratch":
        return (
            f"The encoder has the architecture and input scales of {checkpoint}, but random weights to begin with.\n\n"
        )
    kept = "stays as it was" if config.latent.use == "frozen" else "goes on learning"
    return f"The encoder is that of {checkpoint}, pretrained {pretraining(config.latent)}; it {kept}.\n\n"


def _paper(config: TrainingConfig) -> str:
    words = centering_words(config.encoder, config.model, config.train_samples)
    return f"| paper, same cell, simulation, 3 seeds | {words} |\n" if _published(config) else ""


def _same_task(config: TrainingConfig) -> str:
    if not _published(config):
        return ""
    return (
        " The paper's data are not\npublished: its figure is of the same task if the samples are of block centering, "
        "not of the same samples."
    )


def _published(config: TrainingConfig) -> bool:
    """Return whether the paper has a figure for the same cell, which is one without pretraining."""
    figure = centering_figure(config.encoder, config.model, config.train_samples)
    return config.latent is None and figure is not None


def _separate(result: Result) -> str:
    accuracy = result.separate_test_accuracy
    return "" if accuracy is None else f"| separate test set | {accuracy:.1%} |\n"


def _offsets(result: Result) -> str:
    if result.offset_error_mm is None:
        return ""
    return f"Predicted offsets are {result.offset_error_mm:.1f} mm off on average; the direction is read off them.\n"


def _stopping(config: TrainingConfig, result: Result) -> str:
    if not config.patience:
        return f"The training lasted {result.epochs} epochs, whatever the test accuracy."
    if result.epochs < config.epochs:
        watched, paper = "test accuracy", ", as in the paper"
        if config.valid_samples:
            watched, paper = "accuracy on the validation samples", ""
        return (
            f"The training stopped after {result.epochs} of at most {config.epochs} epochs, when the {watched} had "
            f"not improved for {config.patience}{paper}."
        )
    return f"The training lasted all {result.epochs} epochs that it was allowed."


def _classes(result: Result) -> str:
    return ", ".join(f"{count} {name}" for name, count in zip(DIRECTIONS, result.train_samples, strict=True))


def plot_confusion(confusion: np.ndarray, path: Path, title: str) -> None:
    """Draw the number of samples by true and predicted direction.

    Args:
        confusion: Number of samples by true (row) and predicted (column) direction, shape (4, 4).
        path: PNG file to write.
        title: Title of the figure.
    """
    figure = Figure(figsize=(4.4, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.imshow(confusion, cmap="Blues", vmin=0)
    for (row, column), count in np.ndenumerate(confusion):
        color = "white" if count > confusion.max() / 2 else "black"
        axes.text(column, row, str(count), ha="center", va="center", color=color)
    axes.set(xlabel="predicted", ylabel="true", xticks=range(4), yticks=range(4))
    axes.set_xticklabels(DIRECTIONS)
    axes.set_yticklabels(DIRECTIONS)
    axes.set_title(title, fontsize=10)
    write_figure(figure, path, dpi=120)
