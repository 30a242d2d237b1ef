"""Accuracy against training time for several widths and groups, from which the default network was chosen.

    python benchmarks/sizes.py --data data/centering --separate-test data/centering_test --out out/sizes

Every network is trained for several numbers of epochs, with the whole learning-rate cycle each time, so that a short
training is as good as a short training can be. Training seconds are those of one core; their ratios matter, not the
seconds themselves. The same command continues where it was stopped. It writes sizes.png and prints a Markdown table.
"""

import argparse
import platform
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.page import markdown
from svfl_models.experiments.results import Cell, Results
from svfl_models.experiments.runs.folder import RUNS, claimed, describe
from svfl_models.experiments.runs.grid import Grid
from svfl_models.experiments.runs.training import Training, run_name
from svfl_models.training.figures import save

NETWORKS = [  # preset, group, epochs
    ("tiny", "D4", (50, 150, 500)),
    ("default", "D4", (50, 150, 500)),
    ("wide", "D4", (50, 150, 500)),
    ("paper", "D4", (15, 50, 150)),
    ("default", "C4", (50, 150, 500)),
    ("default", "D8", (50, 150, 500)),
    ("default", "none", (50, 150, 500)),
]


def configurations(data: Path, encoder: str, samples: int) -> list[TrainingConfig]:
    """Return one training configuration for each network and number of epochs, with seed 0.

    Args:
        data: Folder of the dataset.
        encoder: Name of the encoder.
        samples: Number of training samples.
    """
    base = TrainingConfig(str(data), encoder=encoder, train_samples=samples)
    return [replace(base, preset=p, group=g, epochs=epochs) for p, g, several in NETWORKS for epochs in several]


def draw(results: Results, path: Path) -> None:
    """Draw accuracy on the separate test set against training seconds, with a line for each network.

    Args:
        results: Results of all runs.
        path: Image file to write.
    """
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    axes = figure.subplots()
    for preset, group, _ in NETWORKS:
        cells = results.find(preset=preset, group=group)
        known = [(cell.seconds.mean, cell.separate) for cell in cells if cell.seconds and cell.separate]
        if known:
            seconds, accuracies = zip(*known, strict=True)
            axes.errorbar(
                seconds, [a.mean for a in accuracies], [a.error or 0 for a in accuracies],
                fmt="o-" if group == "D4" else "s--", capsize=3, label=f"{preset}, {group}",
            )  # fmt: skip
    config = results.cells[0].config
    title = f"{config.encoder.upper()}, {config.train_samples} training samples"
    axes.set(xscale="log", xlabel="training time, s (one core)", ylabel="accuracy on the separate test set, %")
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend()
    save(figure, path)


def row(cell: Cell) -> list[object]:
    """Return the cells of a table row for one network at one number of epochs."""
    parameters, seconds = cell.mean("parameters"), cell.seconds
    config = cell.config
    return [
        config.preset, config.group, f"{parameters.mean:,.0f}" if parameters else "-", config.epochs,
        f"{seconds.mean:.0f}" if seconds else "-", cell.words(cell.test), cell.words(cell.separate),
    ]  # fmt: skip


def main() -> None:
    """Train all networks, draw the figure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data/centering"))
    parser.add_argument("--separate-test", type=Path, default=Path("data/centering_test"))
    parser.add_argument("--encoder", default="vf")
    parser.add_argument("--train-samples", type=int, default=25)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/sizes"))
    options = parser.parse_args()
    cells = configurations(options.data, options.encoder, options.train_samples)
    runs = {
        run_name(config, replace(cells[0], epochs=0, preset="")): config
        for cell in cells
        for config in (replace(cell, seed=seed) for seed in range(options.seeds))
    }
    base = replace(cells[0], group="D4", preset="default")
    with claimed(options.out, describe("sizes", base, options.separate_test)):
        separate = options.separate_test
        jobs = {name: Training(config, options.out / RUNS / name, separate) for name, config in runs.items()}
        Grid(options.out, jobs).run(options.workers, Console(stderr=True))
        results = Results(runs, options.out / RUNS)
        draw(results, options.out / "sizes.png")
    print(f"{platform.processor() or platform.machine()}; {' '.join(cell_words(options))}\n")
    header = ["preset", "group", "parameters", "epochs", "training, s", "test split, %", "separate test set, %"]
    print(markdown(header, [row(cell) for cell in results.cells]))


def cell_words(options: argparse.Namespace) -> list[str]:
    """Return a description of what was trained, as words for the line above the table."""
    return [f"encoder {options.encoder},", f"{options.train_samples} training samples,", f"{options.seeds} seeds"]


if __name__ == "__main__":
    main()
