"""Writes the report of a behaviour cloning run: the errors on held-out demonstrations, and learning curves."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from svfl_data.system.printable import markdown
from svfl_models.cloning.config import CloningConfig
from svfl_models.training import run_folder
from svfl_models.training.progress import History
from svfl_models.training.provenance import words
from svfl_models.training.provenance.session import Session
from svfl_models.training.run_report import Panel, plot_curves, settings_table
from svfl_models.training.writing import write_text

NAMES = {"svfl": "SVFL", "cnn": "CNN"}
WORSE = 1.1
"""Ratio of the last held-out loss to the lowest one above which a report says that the loss has risen again."""


@dataclass(frozen=True)
class Result:
    """Outcome of a training; errors are those of the last epoch on the held-out episodes (`module.errors`).

    Attributes:
        train_loss: Mean loss of the last epoch on the training episodes.
        valid_loss: Mean loss of the last epoch on the held-out episodes.
        valid_gripper: Share of the gripper openings that were wrong, 0..1; None for an action without a gripper.
        valid_error: Mean absolute error of the action, as a share of half the range between its bounds.
        valid_xy_mm: Mean distance between predicted and demonstrated (dx, dy), [mm]; None for an action of the
            user's own.
        valid_z_mm: Mean distance between predicted and demonstrated dz, [mm]; None likewise.
        valid_turn_deg: Mean absolute difference between predicted and demonstrated dtheta, [deg]; None
            likewise.
        episodes: Number of training episodes, then of held-out episodes.
        steps: Number of steps in the training episodes, then in the held-out episodes.
        epochs: Number of epochs trained.
        seconds: Duration of the training without imports and loading, [s].
        parameters: Number of trained parameters of the network.
    """

    train_loss: float
    valid_loss: float
    valid_gripper: float | None
    valid_error: float
    valid_xy_mm: float | None
    valid_z_mm: float | None
    valid_turn_deg: float | None
    episodes: list[int]
    steps: list[int]
    epochs: int
    seconds: float
    parameters: int


def run_name(config: CloningConfig, task: str) -> str:
    """Return the task, inputs, network and number of demonstrations of a run in words.

    Args:
        config: Configuration of the run.
        task: Name of the task of the demonstrations.
    """
    inputs = "own inputs" if config.inputs else "+".join(config.encoder.upper())
    rotated = ", rotated samples" if config.rotate else ""
    group = "" if config.group in ("D4", "none") else f" ({config.group})"
    return f"{task}, {inputs} {NAMES[config.model]}{group}{rotated}, {config.episodes} demonstrations"


def write_report(
    out: Path, config: CloningConfig, task: str, result: Result, history: History, sessions: Sequence[Session] = ()
) -> None:
    """Write the learning curves and the page of a run into its folder.

    Args:
        out: Folder of the run.
        config: Configuration of the run.
        task: Name of the task of the demonstrations.
        result: Outcome of the run.
        history: Metrics of each epoch.
        sessions: Provenance of the run.
    """
    plot_curves(history, _panels(result), out / run_folder.LEARNING_CURVE, run_name(config, task))
    write_text(out / run_folder.REPORT, page(config, task, result, history, sessions))


def page(config: CloningConfig, task: str, result: Result, history: History, sessions: Sequence[Session] = ()) -> str:
    """Return the report of a run in Markdown.

    Args:
        config: Configuration of the run.
        task: Name of the task of the demonstrations.
        result: Outcome of the run.
        history: Metrics of each epoch.
        sessions: Provenance of the run.
    """
    provenance = "".join(f"\n{words.section(one)}" for one in sessions)
    rows = "\n".join(f"| {name} | {value} |" for name, value in _errors(result))
    (learned, held_out), (steps, held_out_steps) = result.episodes, result.steps
    return f"""# Behaviour cloning: {markdown(run_name(config, task))}

| final weights, {held_out} held-out demonstration{"s" * (held_out > 1)} ({held_out_steps} steps) | |
| --- | --- |
{rows}

Learned from {steps} steps of {learned} demonstration{"s" * (learned > 1)}; {result.parameters:,} parameters, \
{result.epochs} epochs, {result.seconds:.0f} s of training.{_course(history)}

![learning curve]({run_folder.LEARNING_CURVE})

{settings_table(config.plain())}{provenance}"""


def _errors(result: Result) -> list[tuple[str, str]]:
    """Return names and values of the errors that the action of a policy has."""
    found = [("loss", f"{result.valid_loss:.4g}")]
    if result.valid_gripper is not None:
        found.append(("gripper wrong", f"{result.valid_gripper:.1%}"))
    if result.valid_xy_mm is not None:
        found += [
            ("(dx, dy) off", f"{result.valid_xy_mm:.1f} mm"),
            ("dz off", f"{result.valid_z_mm:.1f} mm"),
            ("dtheta off", f"{result.valid_turn_deg:.1f} deg"),
        ]
    return [*found, ("action off, mean over its components", f"{result.valid_error:.1%} of half its range")]


def _course(history: History) -> str:
    """Return a sentence on a held-out loss that has risen again; empty if it has not."""
    known = ((int(row["epoch"]) + 1, row.get("valid_loss", math.nan)) for row in history)
    losses = {epoch: loss for epoch, loss in known if math.isfinite(loss)}
    if not losses:
        return ""
    best, last = min(losses, key=lambda epoch: losses[epoch]), losses[max(losses)]
    lowest = losses[best]
    if last - lowest <= (WORSE - 1) * abs(lowest):
        return ""
    return (
        f" The loss on held-out demonstrations was lowest after {best} epoch{'s' * (best > 1)} ({lowest:.4g}) and has "
        f"risen to {last:.4g} since."
    )


def _panels(result: Result) -> list[Panel]:
    loss = Panel("loss", {"train_loss": "learned from", "valid_loss": "held out"})
    if result.valid_xy_mm is None:
        error = Panel("error, held out, % of half the range", {"valid_error": "action"}, factor=100)
    else:
        error = Panel("error, held out, mm", {"valid_xy_mm": "(dx, dy)", "valid_z_mm": "dz"})
    return [loss, error]
