"""Writes the report of a pretraining: its last losses, term by term, and learning curves."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from svfl_data.system.printable import markdown
from svfl_models.latent.config import TERMS, LatentConfig
from svfl_models.latent.progress import Row
from svfl_models.training import run_folder
from svfl_models.training.provenance import words
from svfl_models.training.provenance.session import Session
from svfl_models.training.run_report import Panel, plot_curves, settings_table
from svfl_models.training.writing import write_text

STAGES = {"train": "learned from", "valid": "held out"}


@dataclass(frozen=True)
class LatentResult:
    """Outcome of a pretraining.

    Attributes:
        steps: Number of steps done, including those of interrupted runs.
        seconds: Duration of the training, including that of interrupted runs, [s].
        parameters: Number of trained parameters of each part of the network.
        train_sequences: Number of training sequences.
        valid_sequences: Number of held-out sequences.
        last: Metrics of the last leg, as in the metrics file.
    """

    steps: int
    seconds: float
    parameters: dict[str, int]
    train_sequences: int
    valid_sequences: int
    last: Row


def write_report(
    out: Path, config: LatentConfig, result: LatentResult, history: Sequence[Row], sessions: Sequence[Session] = ()
) -> None:
    """Write the learning curves and the page of a pretraining into its folder.

    Args:
        out: Folder of the run.
        config: Configuration of the run.
        result: Outcome of the run.
        history: Metrics of each leg.
        sessions: Provenance of the run.
    """
    panels = [Panel("loss", {f"{stage}_loss": name for stage, name in STAGES.items()})]
    plot_curves(history, panels, out / run_folder.LEARNING_CURVE, _name(config), place="step")
    write_text(out / run_folder.REPORT, page(config, result, sessions))


def page(config: LatentConfig, result: LatentResult, sessions: Sequence[Session] = ()) -> str:
    """Return the report of a pretraining in Markdown.

    Args:
        config: Configuration of the run.
        result: Outcome of the run.
        sessions: Provenance of the run.
    """
    provenance = "".join(f"\n{words.section(one)}" for one in sessions)
    names = [name for name in TERMS if f"train_{name}_weighted" in result.last]
    rows = [f"| **loss** | {' | '.join(_last(result, f'{stage}_loss') for stage in STAGES)} |"]
    for name in names:
        rows.append(f"| {name} | {' | '.join(_last(result, f'{stage}_{name}_weighted') for stage in STAGES)} |")
    parts = ", ".join(f"{name} {count:,}" for name, count in result.parameters.items())
    table = "\n".join(rows)
    return f"""# Pretraining: {markdown(_name(config))}

| last losses | {" | ".join(STAGES.values())} |
| --- | --- | --- |
{table}

Terms as they enter the loss. {result.train_sequences:,} sequences were learned from, {result.valid_sequences:,} \
held out; {sum(result.parameters.values()):,} parameters ({parts}), {result.steps:,} steps, \
{result.seconds:.0f} s of training.

![learning curve]({run_folder.LEARNING_CURVE})

{settings_table(config.plain())}{provenance}"""


def _name(config: LatentConfig) -> str:
    return f"{config.model}, preset {config.preset}, seed {config.seed}"


def _last(result: LatentResult, name: str) -> str:
    return f"{result.last[name]:.4g}" if name in result.last else "-"
