"""Callbacks that write down and show how a pretraining goes, leg by leg."""

import csv
import time
from pathlib import Path

import lightning.pytorch as pl
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from svfl_models.latent.module import LatentModule, columns

Row = dict[str, float]


class LegsFile(pl.Callback):
    """One row per leg: means over its steps, and over the validation sequences after it.

    Args:
        path: CSV file to write.
        done: Steps that an earlier run has done; its rows up to there are kept, later ones are done again.

    Attributes:
        rows: The rows so far.
    """

    def __init__(self, path: Path, done: int = 0) -> None:
        self.path = path
        self.rows = [row for row in read_rows(path) if row["step"] <= done]
        self.start = time.monotonic() - (self.rows[-1]["seconds"] if self.rows else 0.0)

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the file."""
        with self.path.open("w", newline="") as file:
            csv.writer(file).writerow(columns())
        for row in self.rows:
            self._append(row)

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Append a row."""
        figures = {name: float(value) for name, value in trainer.callback_metrics.items()}
        seconds = round(time.monotonic() - self.start, 1)
        self.rows.append({"step": steps_of(pl_module), "seconds": seconds} | figures)
        self._append(self.rows[-1])

    def _append(self, row: Row) -> None:
        with self.path.open("a", newline="") as file:
            csv.writer(file).writerow([f"{row[name]:.6g}" if name in row else "" for name in columns()])


def read_rows(path: Path) -> list[Row]:
    """Rows of a metrics file; none if there is no file."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return [{name: float(value) for name, value in row.items() if value} for row in csv.DictReader(file)]


def steps_of(module: pl.LightningModule) -> int:
    """Steps of a training so far, those before an interruption included."""
    assert isinstance(module, LatentModule)
    return module.steps


class StepsBar(pl.Callback):
    """A progress bar on a terminal, a line per leg elsewhere.

    Args:
        steps: Of the whole training.
        console: Where to print.
    """

    def __init__(self, steps: int, console: Console) -> None:
        self.steps, self.console = steps, console
        fields = (TextColumn("step"), MofNCompleteColumn(), BarColumn(), TextColumn("{task.description}"))
        self.bar = Progress(*fields, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True)
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

    def on_fit_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Take the bar away."""
        self._take_away()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """Take the bar away, so that the message stands alone."""
        self._take_away()

    def _take_away(self) -> None:
        if self.console.is_terminal:
            self.bar.stop()
