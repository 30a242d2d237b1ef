"""The page of a table of behaviour cloning: success by task and network, learning curves, and how it was made."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from svfl_data.system.printable import markdown as escaped
from svfl_models.centering.report import NAMES
from svfl_models.experiments.cloning_table import GROUPS, Rate, Run
from svfl_models.experiments.figures import MODEL_COLOURS, panels
from svfl_models.experiments.page import duration, markdown
from svfl_models.training import run_folder
from svfl_models.training.figures import save
from svfl_models.training.writing import read_numbers, write_rows, write_text

PICTURES = ("bc_success.png", "bc_curves.png")
ERRORS = {"valid_gripper": "gripper wrong, %", "valid_xy_mm": "(dx, dy), mm", "valid_z_mm": "dz, mm"}
FEWER = "\n- These are the epochs with {most} demonstrations; with fewer there are more, for equally many steps."


class Table:
    """The runs of a table, looked up by task, number of demonstrations and network.

    Args:
        runs: All runs of the table, finished or not, with the same number of trials each.

    Attributes:
        runs: All runs of the table.
        trials: Number of episodes that each policy is evaluated in.
        tasks: Names of the tasks, in the order of the runs.
        counts: Numbers of demonstrations, in increasing order.
    """

    def __init__(self, runs: Sequence[Run]) -> None:
        self.runs, self.trials = list(runs), runs[0].trials
        self.tasks = list(dict.fromkeys(run.task for run in runs))
        self.counts = sorted({run.config.episodes for run in runs})

    def find(self, task: str, count: int, model: str) -> list[tuple[Run, dict[str, Any]]]:
        """Return the finished runs of all seeds, each with its outcome.

        Args:
            task: Name of the task.
            count: Number of demonstrations.
            model: Kind of network, ``svfl`` or ``cnn``.
        """
        wanted = [run for run in self.runs if (run.task, run.config.episodes, run.config.model) == (task, count, model)]
        return [(run, outcome) for run in wanted if (outcome := run.outcome())]

    def rate(self, task: str, count: int, model: str) -> Rate | None:
        """Return the success rate over the finished seeds, or None if no seed is finished.

        Args:
            task: Name of the task.
            count: Number of demonstrations.
            model: Kind of network, ``svfl`` or ``cnn``.
        """
        found = [outcome for _, outcome in self.find(task, count, model)]
        return Rate.of(found) if found else None


def write(table: Table, command: str, out: Path, provenance: str = "") -> tuple[str, list[Path]]:
    """Write the page, its figures and ``runs.csv``.

    Args:
        table: Runs of the table.
        command: Command line that makes the table again.
        out: Folder to write to.
        provenance: Section on the provenance of the page, in Markdown; empty for none.

    Returns:
        The page in Markdown, and the files that were written: page, figures and ``runs.csv``.
    """
    words = "\n\n".join(
        ["# Behaviour cloning: success in simulation", _success(table), _errors(table), _how(table, command)]
        + [provenance.rstrip()] * bool(provenance)
    )
    page = out / "bc_table.md"
    write_text(page, words + "\n")
    pictures = [_draw_success(table, out / PICTURES[0]), _draw_curves(table, out / PICTURES[1])]
    return words, [page, *pictures, _write_runs(table, out / "runs.csv")]


def _success(table: Table) -> str:
    rows, verdicts = [], []
    for task in table.tasks:
        for count in table.counts:
            rates = {model: table.rate(task, count, model) for model in GROUPS}
            for model, rate in rates.items():
                rows.append([escaped(task), count, NAMES[model], *_rate_words(rate)])
            if all(rates.values()) and count == table.counts[-1]:
                svfl, cnn = (rates[model].share for model in GROUPS)  # type: ignore[union-attr] # no rate is None
                verdicts.append(f"{escaped(task)} {svfl - cnn:+.0%}".replace("%", " points"))
    header = ["task", "demonstrations", "network", "success", "95 % interval", "each seed"]
    return (
        f"{markdown(header, rows)}\n\nEach policy was tried in {table.trials} scenes that no demonstration has, the "
        f"same for all. The interval is Wilson's over all trials of a row.\nSVFL minus CNN with {table.counts[-1]} "
        f"demonstrations: {', '.join(verdicts) or 'not known yet'}.\n\n![success by task]({PICTURES[0]})"
    )


def _rate_words(rate: Rate | None) -> list[str]:
    if rate is None:
        return ["-", "-", "-"]
    low, high = rate.interval
    return [f"{rate.share:.1%}", f"{low:.0%} to {high:.0%}", ", ".join(f"{one:.0%}" for one in rate.by_seed)]


def _errors(table: Table) -> str:
    """Return the section on errors on held-out demonstrations, with numbers of parameters and training times."""
    rows = []
    for task in table.tasks:
        for model in GROUPS:
            found = [outcome for _, outcome in table.find(task, table.counts[-1], model)]
            if found:
                means = {name: float(np.mean([one[name] for one in found])) for name in (*ERRORS, "seconds")}
                rows.append(
                    [task, NAMES[model], f"{100 * means['valid_gripper']:.1f}", f"{means['valid_xy_mm']:.1f}",
                     f"{means['valid_z_mm']:.1f}", f"{found[0]['parameters']:,}", f"{means['seconds']:.0f}"]
                )  # fmt: skip
    header = ["task", "network", *ERRORS.values(), "parameters", "training, s"]
    return (
        "Errors on held-out demonstrations, mean over the seeds:\n\n"
        f"{markdown(header, rows)}\n\n![learning curves]({PICTURES[1]})"
    )


def _how(table: Table, command: str) -> str:
    config = next(run.config for run in table.runs if run.config.episodes == table.counts[-1]).plain()
    left_out = ("data", "episodes", "group", "seed")
    recipe = ", ".join(
        f"{name} {value}" for name, value in config.items() if name not in left_out and value is not None
    )
    done = [outcome for run in table.runs if (outcome := run.outcome())]
    seconds = sum(one["seconds"] for one in done)
    return (
        f"## How\n\nGenerated by\n\n    {command}\n\n- {len(table.runs)} policies, {len(done)} of them finished; "
        f"{duration(seconds)} of training together, one thread each.\n- Of the demonstrations, a tenth is held out.\n"
        f"- Same recipe for both networks: {recipe}."
        + ("" if len(table.counts) == 1 else FEWER.format(most=table.counts[-1]))
    )


def _draw_success(table: Table, file: Path) -> Path:
    figure, axes = panels(1, len(table.tasks), 3.4)
    for panel, task in zip(axes, table.tasks, strict=True):
        for place, model in enumerate(GROUPS):
            for position, count in enumerate(table.counts):
                if rate := table.rate(task, count, model):
                    _bar(panel, position + 0.4 * (place - 0.5), rate, model, label=position == 0)
        panel.set(title=task.replace("_", " "), xlabel="demonstrations", ylim=(0, 100))
        panel.set_xticks(range(len(table.counts)), [str(count) for count in table.counts])
        panel.set_xlim(-0.7, len(table.counts) - 0.3)
        panel.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("success, % (dots: seeds)")
    handles, names = axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, names, loc="outside lower center", ncols=len(names))
    return save(figure, file)


def _bar(panel: Axes, place: float, rate: Rate, model: str, label: bool) -> None:
    low, high = rate.interval
    panel.bar(place, 100 * rate.share, 0.36, color=MODEL_COLOURS[model], label=NAMES[model] if label else None)
    spread = [[100 * (rate.share - low)], [100 * (high - rate.share)]]
    panel.errorbar(place, 100 * rate.share, spread, color="black", capsize=3)
    spots = place + np.linspace(-0.08, 0.08, len(rate.by_seed))
    panel.plot(spots, [100 * one for one in rate.by_seed], "o", color="white", markeredgecolor="black", markersize=4)


def _draw_curves(table: Table, file: Path) -> Path:
    """Draw the loss by epoch, for the demonstrations that are learned from and for those that are held out."""
    figure, axes = panels(1, len(table.tasks), 3.4)
    for panel, task in zip(axes, table.tasks, strict=True):
        for model in GROUPS:
            curves = [_metrics(run.folder) for run, _ in table.find(task, table.counts[-1], model)]
            for name, style, words in (("train_loss", ":", "learned from"), ("valid_loss", "-", "held out")):
                if curves:
                    mean = np.mean([curve[name] for curve in curves], axis=0)
                    panel.plot(
                        1 + np.arange(len(mean)),
                        mean,
                        style,
                        color=MODEL_COLOURS[model],
                        label=f"{NAMES[model]}, {words}",
                    )
        panel.set(title=task.replace("_", " "), xlabel="epoch", yscale="log")
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("loss")
    if axes[0].get_legend_handles_labels()[0]:
        axes[0].legend(fontsize=8)
    return save(figure, file)


def _metrics(folder: Path) -> dict[str, list[float]]:
    rows = read_numbers(folder / run_folder.METRICS)
    return {name: [row[name] for row in rows] for name in ("train_loss", "valid_loss")}


def _write_runs(table: Table, file: Path) -> Path:
    rows: list[list[object]] = [
        ["task", "model", "demonstrations", "seed", "success", "trials", *ERRORS, "epochs", "seconds"]
    ]
    for run in table.runs:
        if found := run.outcome():
            said = [f"{found[name]:.4g}" for name in ERRORS]
            config = run.config
            rows.append(
                [run.task, config.model, config.episodes, config.seed, sum(found["success"]), table.trials, *said,
                 found["epochs"], f"{found['seconds']:.0f}"]
            )  # fmt: skip
    write_rows(file, rows)
    return file
