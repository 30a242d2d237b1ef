"""Callbacks that write down and show how a pretraining goes, leg by leg."""

from collections.abc import Iterator
from pathlib import Path

import lightning.pytorch as pl
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from svfl_data.errors import FormatError
from svfl_models.latent.module import LatentModule, columns
from svfl_models.training.progress import Bar, MetricsFile
from svfl_models.training.writing import read_numbers

Row = dict[str, float]


class LegsFile(MetricsFile):
    """One row per leg: means over its steps, and over the validation sequences after it.

    Args:
        path: CSV file to write.
        done: Steps that an earlier run has done; its rows up to there are kept, later ones are done again.
    """

    def __init__(self, path: Path, done: int = 0) -> None:
        super().__init__(path, columns(), _kept(path, done))

    def place(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> Row:
        """Where in the training a row belongs."""
        return {"step": steps_of(pl_module)}


def _kept(path: Path, done: int) -> Iterator[Row]:
    """Rows of a metrics file up to a step; none if there is no file."""
    for row in read_numbers(path) if path.is_file() else []:
        if "step" not in row:
            raise FormatError(f"{path}: not the metrics of a training (a line has no step)")
        if row["step"] <= done:
            yield row


def steps_of(module: pl.LightningModule) -> int:
    """Steps of a training so far, those before an interruption included."""
    assert isinstance(module, LatentModule)
    return module.steps


class StepsBar(Bar):
    """A progress bar on a terminal, a line per leg elsewhere.

    Args:
        steps: Of the whole training.
        console: Where to print.
    """

    def __init__(self, steps: int, console: Console) -> None:
        fields = (TextColumn("step"), MofNCompleteColumn(), BarColumn(), TextColumn("{task.description}"))
        bar = Progress(*fields, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True)
        super().__init__(bar, console)
        self.steps = steps
        self.task = self.bar.add_task("", total=steps)

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the bar."""
        if self.console.is_terminal:
            self.bar.update(self.task, completed=steps_of(pl_module))
            self.bar.start()

    def on_train_batch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: object) -> None:
        """Move the bar."""
        if self.console.is_terminal:
            self.bar.update(self.task, completed=steps_of(pl_module))

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the leg's losses."""
        metrics = trainer.callback_metrics
        words = f"loss {float(metrics['train_loss']):.4g}, held out {float(metrics['valid_loss']):.4g}"
        if self.console.is_terminal:
            self.bar.update(self.task, description=words)
        else:
            self.console.print(f"step {steps_of(pl_module)}/{self.steps}: {words}", highlight=False)
