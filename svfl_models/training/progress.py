"""Callbacks that write down and show how a training goes."""

import csv
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import lightning.pytorch as pl
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from svfl_models.training.writing import write_rows

COLUMNS = ("epoch", "train_loss", "train_accuracy", "test_loss", "test_accuracy", "seconds")
QUIET_SECONDS = 10.0
"""Time between two lines where the output is not a terminal."""

History = list[dict[str, float]]


class MetricsFile(pl.Callback):
    """One row per epoch, on disk as soon as the epoch is over; without figures of a validation where there was none.

    Args:
        path: CSV file to write.
        columns: What to write down; ``seconds`` is the time of the training.
        rows: Those of an earlier training that this one continues.

    Attributes:
        rows: The rows so far.
    """

    def __init__(self, path: Path, columns: Sequence[str] = COLUMNS, rows: Iterable[dict[str, float]] = ()) -> None:
        self.path, self.columns = path, tuple(columns)
        self.rows: History = list(rows)
        self.start = 0.0

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the clock and the file."""
        self.start = time.monotonic() - (self.rows[-1]["seconds"] if self.rows else 0.0)
        write_rows(self.path, [self.columns, *map(self._words, self.rows)])

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Append a row."""
        every = trainer.check_val_every_n_epoch or 1
        tested = trainer.current_epoch % every == every - 1
        figures = {
            name: float(value)
            for name, value in trainer.callback_metrics.items()
            if name in self.columns and (tested or not name.startswith("test"))  # else a figure of an earlier epoch
        }
        seconds = round(time.monotonic() - self.start, 2)
        self.rows.append(self.place(trainer, pl_module) | {"seconds": seconds} | figures)
        with self.path.open("a", newline="") as file:
            csv.writer(file).writerow(self._words(self.rows[-1]))

    def place(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> dict[str, float]:
        """Where in the training a row belongs."""
        return {"epoch": trainer.current_epoch}

    def _words(self, row: dict[str, float]) -> list[str]:
        return [f"{row[name]:.6g}" if name in row else "" for name in self.columns]


class Bar(pl.Callback):
    """A bar that goes away with its training, whatever ends that.

    Args:
        bar: To be started and moved on a terminal.
        console: Where to print.
    """

    def __init__(self, bar: Progress, console: Console) -> None:
        self.bar, self.console = bar, console

    def on_fit_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Take the bar away."""
        self._take_away()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """Take the bar away, so that the message stands alone."""
        self._take_away()

    def _take_away(self) -> None:
        if self.console.is_terminal:
            self.bar.stop()


class ProgressLine(Bar):
    """A progress bar on a terminal, an occasional line elsewhere.

    Args:
        epochs: Most epochs there can be.
        console: Where to print.
    """

    def __init__(self, epochs: int, console: Console) -> None:
        columns = (TextColumn("epoch"), MofNCompleteColumn(), BarColumn(), TextColumn("{task.description}"))
        super().__init__(Progress(*columns, TimeElapsedColumn(), console=console, transient=True), console)
        self.epochs = epochs
        self.best = 0.0
        self.next_line = 0.0
        self.task = self.bar.add_task("", total=epochs)

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the bar."""
        self.next_line = time.monotonic() + QUIET_SECONDS
        if self.console.is_terminal:
            self.bar.start()

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the epoch's figures."""
        metrics = trainer.callback_metrics
        loss, accuracy = float(metrics["train_loss"]), float(metrics.get("test_accuracy", 0))
        self.best = max(self.best, accuracy)
        words = f"loss {loss:.3f}, test accuracy {accuracy:.1%}, best {self.best:.1%}"
        epoch = trainer.current_epoch + 1
        if self.console.is_terminal:
            self.bar.update(self.task, completed=epoch, description=words)
        elif time.monotonic() >= self.next_line:
            self.console.print(f"epoch {epoch}/{self.epochs}: {words}", highlight=False)
            self.next_line = time.monotonic() + QUIET_SECONDS
