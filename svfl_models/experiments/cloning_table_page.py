"""The page of a table of behaviour cloning: success by task and network, learning curves, and how it was made."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.system.printable import markdown as escaped
from svfl_models.experiments import cloning_table_figures as figures
from svfl_models.experiments.cloning_table import Table
from svfl_models.experiments.page import duration, markdown, seeds_words
from svfl_models.experiments.seed_intervals import Interval, difference, interquartile_mean, success_rate
from svfl_models.training.writing import write_rows, write_text

PICTURES = ("bc_success.png", "bc_curves.png")
NAMES = {"svfl": "SVFL", "cnn": "CNN", "cnn-rotated": "CNN, rotated and mirrored samples"}
"""Names of the networks on the page; the last one is that of the centering ablation."""
ERRORS = {"valid_gripper": "gripper wrong, %", "valid_xy_mm": "(dx, dy), mm", "valid_z_mm": "dz, mm"}
Place = tuple[str, int, str]
"""Task, number of demonstrations and network, see `cloning_table.Table.success`."""
Pair = tuple[list[Any], tuple[Place, Place]]
"""Label of a difference, and what is compared."""
Compared = tuple[list[Any], Interval]
"""Label and value of a difference."""
FEWER = "\n- These are the epochs with {most} demonstrations; with fewer there are more, for equally many steps."


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
    parts = [_success(table), _differences(table), _all_tasks(table), _errors(table), _how(table, command)]
    words = "\n\n".join(filter(None, ["# Behaviour cloning: success in simulation", *parts, provenance.rstrip()]))
    page = out / "bc_table.md"
    write_text(page, words + "\n")
    pictures = [
        figures.draw_success(table, NAMES, out / PICTURES[0]),
        figures.draw_curves(table, NAMES, out / PICTURES[1]),
    ]
    return words, [page, *pictures, _write_runs(table, out / "runs.csv")]


def _success(table: Table) -> str:
    rows = []
    for task in table.tasks:
        for count in table.counts:
            for network in table.networks:
                rows.append([escaped(task), count, NAMES[network], *_rate(table.success(task, count, network))])
    header = ["task", "demonstrations", "network", "success", "95 % interval", "each seed"]
    return (
        f"{markdown(header, rows)}\n\nEach policy was evaluated in the same {table.test_episodes} scenes, "
        f"which are in no demonstration. {_about_intervals(table)}\n\n![success by task]({PICTURES[0]})"
    )


def _rate(trials: np.ndarray | None) -> list[str]:
    if trials is None:
        return ["-", "-", "-"]
    found = success_rate(trials)
    seeds = ", ".join(f"{one:.0%}" for one in trials.mean(axis=1))
    return [f"{found.value:.1%}", f"{found.low:.0%} to {found.high:.0%}", seeds]


def _about_intervals(table: Table) -> str:
    """Return what the intervals include, which depends on the number of finished seeds."""
    known = [len(rates) for row in _cells(table) if (rates := table.success(*row)) is not None]
    if not known:
        return "No policy has been evaluated yet."
    single, several = min(known) == 1, max(known) > 1
    words = []
    if several:
        words.append(
            "The interval is for newly trained policies in new random scenes: seeds and scenes are resampled "
            "(bootstrap, expanded for few seeds)."
        )
    if single:
        words.append(
            f"Of {'rows with ' if several else ''}one seed the spread between seeds is unknown, and the interval "
            "(Wilson's) is that of this policy in new random scenes."
        )
    return " ".join(words)


def _cells(table: Table) -> list[Place]:
    return [(task, count, name) for task in table.tasks for count in table.counts for name in table.networks]


def _differences(table: Table) -> str:
    """Return the section on differences between networks, and between numbers of demonstrations."""
    networks: list[Pair] = [
        ([escaped(task), count, f"SVFL minus {NAMES[other]}"], ((task, count, "svfl"), (task, count, other)))
        for task in table.tasks
        for count in table.counts
        for other in table.networks
        if other != "svfl"
    ]
    demonstrations: list[Pair] = [
        ([escaped(task), f"{more} minus {fewer}", NAMES[name]], ((task, more, name), (task, fewer, name)))
        for task in table.tasks
        for name in table.networks
        for fewer, more in pairwise(table.counts)
    ]
    between, more = _compared(table, networks), _compared(table, demonstrations)
    if not between and not more:
        return ""
    rows = [[*label, f"{100 * one.value:+.0f}", _points(one), _significance(one)] for label, one in (*between, *more)]
    header = ["task", "demonstrations", "network", "difference, points", "95 % interval", "significant"]
    return f"## Differences\n\n{markdown(header, rows)}{_falls(more)}"


def _compared(table: Table, pairs: Sequence[Pair]) -> list[Compared]:
    """Return the differences of those pairs of which both have a finished seed, each with its label."""
    found = []
    for label, (one, other) in pairs:
        trials, others = table.success(*one), table.success(*other)
        if trials is not None and others is not None:
            found.append((label, difference(trials, others)))
    return found


def _points(found: Interval) -> str:
    return f"{100 * found.low:+.0f} to {100 * found.high:+.0f}"


def _significance(found: Interval) -> str:
    if not found.between_seeds:
        return "unknown (one seed)"
    return "yes" if found.excludes_zero else "no"


def _falls(compared: Sequence[Compared]) -> str:
    """Return a sentence about networks that succeed less with more demonstrations; empty if there are none."""
    fell = [(label, one) for label, one in compared if one.value < 0]
    if not fell:
        return ""
    told = [f"{task} {name} {counts}" for (task, counts, name), one in fell if one.between_seeds and one.excludes_zero]
    none = "none" if all(one.between_seeds for _, one in fell) else "unknown for a single seed"
    cases = f"{len(compared)} case{'s' * (len(compared) > 1)}"
    return (
        f"\n\nThe success rate is lower with more demonstrations in {len(fell)} of {cases}; significant: "
        f"{'; '.join(told) or none}."
    )


def _all_tasks(table: Table) -> str:
    """Return the section on all tasks together; empty for a single task or if runs are missing."""
    rows: list[list[object]] = []
    single = False
    for count in table.counts:
        for name in table.networks:
            tried = [trials for task in table.tasks if (trials := table.success(task, count, name)) is not None]
            if len(tried) == len(table.tasks) > 1:
                found = interquartile_mean(tried)
                single = single or not found.between_seeds
                rows.append([count, NAMES[name], f"{found.value:.1%}", f"{found.low:.0%} to {found.high:.0%}"])
    if not rows:
        return ""
    header = ["demonstrations", "network", "interquartile mean", "95 % interval"]
    alone = "\n\nWhere a task has one seed, the interval leaves out the spread between seeds." if single else ""
    return (
        f"## All tasks\n\nMean of the middle half of the runs of all {len(table.tasks)} tasks (Agarwal et al., NeurIPS "
        f"2021):\n\n{markdown(header, rows)}{alone}"
    )


def _errors(table: Table) -> str:
    """Return the section on errors on held-out demonstrations, with numbers of parameters and training times."""
    rows, most = [], 0
    for task in table.tasks:
        for network in table.networks:
            found = [outcome for _, outcome in table.find(task, table.counts[-1], network)]
            if found:
                most = max(most, len(found))
                means = {name: float(np.mean([one[name] for one in found])) for name in (*ERRORS, "seconds")}
                rows.append(
                    [escaped(task), NAMES[network], f"{100 * means['valid_gripper']:.1f}",
                     f"{means['valid_xy_mm']:.1f}", f"{means['valid_z_mm']:.1f}", f"{found[0]['parameters']:,}",
                     f"{means['seconds']:.0f}"]
                )  # fmt: skip
    if not rows:
        return ""
    header = ["task", "network", *ERRORS.values(), "parameters", "training, s"]
    return (
        f"## Held-out demonstrations\n\nErrors with {table.counts[-1]} demonstrations, "
        f"{'mean over the seeds' if most > 1 else 'of one seed'}:\n\n"
        f"{markdown(header, rows)}\n\n![learning curves]({PICTURES[1]})"
    )


def _how(table: Table, command: str) -> str:
    config = next(run.config for run in table.runs if run.config.episodes == table.counts[-1])
    left_out = ("data", "episodes", "group", "rotate", "seed", "valid")
    recipe = ", ".join(
        f"{name} {escaped(value)}"
        for name, value in config.plain().items()
        if name not in left_out and value not in (None, [])
    )
    seconds = sum(one["seconds"] for one in table.done)
    return (
        f"## How\n\nGenerated by\n\n    {command}\n\n- {len(table.runs)} policies, {len(table.done)} of them finished: "
        f"{seeds_words(table.seeds)}; {duration(seconds)} of training together, one thread each.\n"
        f"- Of the demonstrations, {config.valid:.0%} are held out.\n"
        f"- {'Same recipe for all networks' if len(table.networks) > 1 else 'Recipe'}: {recipe}."
        + ("" if len(table.counts) == 1 else FEWER.format(most=table.counts[-1]))
    )


def _write_runs(table: Table, file: Path) -> Path:
    rows: list[list[object]] = [
        ["task", "network", "demonstrations", "seed", "success", "test_episodes", *ERRORS, "epochs", "seconds"]
    ]
    for run in table.runs:
        for _, found in [one for one in table.find(run.task, run.config.episodes, run.network) if one[0] is run]:
            said = [f"{found[name]:.4g}" for name in ERRORS]
            config = run.config
            rows.append(
                [run.task, run.network, config.episodes, config.seed, sum(found["success"]), table.test_episodes, *said,
                 found["epochs"], f"{found['seconds']:.0f}"]
            )  # fmt: skip
    write_rows(file, rows)
    return file
