"""Callbacks that record and show the progress of a pretraining, leg by leg (a leg lies between two checkpoints)."""

from collections.abc import Iterator
from pathlib import Path

import lightning.pytorch as pl
from rich.console import Console

from svfl_data.errors import FormatError
from svfl_models.latent.module import LatentModule, columns
from svfl_models.training.progress import Bar, MetricsFile
from svfl_models.training.writing import read_numbers

Row = dict[str, float]


class LegsFile(MetricsFile):
    """CSV file with one row per leg: means over its steps, and over the validation sequences after it.

    Args:
        path: CSV file to write.
        done: Number of steps that an earlier run has done. Its rows up to this step are kept; later steps are done
            again.
    """

    def __init__(self, path: Path, done: int = 0) -> None:
        super().__init__(path, columns(), _kept(path, done))

    def place(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> Row:
        """Return the step that a row belongs to."""
        return {"step": steps_of(pl_module)}


def _kept(path: Path, done: int) -> Iterator[Row]:
    """Yield the rows of a metrics file up to the step `done`; no rows if the file does not exist."""
    for row in read_numbers(path) if path.is_file() else []:
        if "step" not in row:
            raise FormatError(f"{path}: not the metrics of a training (a line has no step)")
        if row["step"] <= done:
            yield row


def steps_of(module: pl.LightningModule) -> int:
    """Return the number of steps of a training so far, including those before an interruption."""
    assert isinstance(module, LatentModule)
    return module.steps


class StepsBar(Bar):
    """Progress display of a training: a bar on a terminal, otherwise one line per leg.

    Args:
        steps: Number of steps of the whole training.
        console: Console to print on.
    """

    def __init__(self, steps: int, console: Console) -> None:
        super().__init__("step", steps, console)
        self.steps = steps

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the bar at the number of steps so far."""
        self.bars.update(self.bar, completed=steps_of(pl_module))
        self.bars.start()

    def on_train_batch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: object) -> None:
        """Move the bar to the number of steps so far."""
        self.bars.update(self.bar, completed=steps_of(pl_module))

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the losses of the leg."""
        metrics = trainer.callback_metrics
        words = f"loss {float(metrics['train_loss']):.4g}, held out {float(metrics['valid_loss']):.4g}"
        if self.bars.shown:
            self.bars.update(self.bar, words=words)
        else:
            self.console.print(f"step {steps_of(pl_module)}/{self.steps}: {words}", highlight=False)
