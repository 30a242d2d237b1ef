"""Callbacks that write down and show how a training goes."""

import csv
import time
from pathlib import Path

import lightning.pytorch as pl
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

COLUMNS = ("epoch", "train_loss", "train_accuracy", "test_loss", "test_accuracy", "seconds")
QUIET_SECONDS = 10.0
"""Time between two lines where the output is not a terminal."""

History = list[dict[str, float]]


class MetricsFile(pl.Callback):
    """One row per epoch, on disk as soon as the epoch is over; without test figures where nobody tested.

    Args:
        path: CSV file to write.

    Attributes:
        rows: The rows written so far.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: History = []
        self.start = time.monotonic()

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the clock and the file."""
        self.start = time.monotonic()
        with self.path.open("w", newline="") as file:
            csv.writer(file).writerow(COLUMNS)

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Append a row."""
        every = trainer.check_val_every_n_epoch or 1
        tested = trainer.current_epoch % every == every - 1
        metrics = {
            name: float(value)
            for name, value in trainer.callback_metrics.items()
            if tested or not name.startswith("test")  # else a figure of an earlier epoch
        }
        row = metrics | {"epoch": trainer.current_epoch, "seconds": round(time.monotonic() - self.start, 2)}
        self.rows.append(row)
        with self.path.open("a", newline="") as file:
            csv.writer(file).writerow([f"{row[name]:.6g}" if name in row else "" for name in COLUMNS])


class ProgressLine(pl.Callback):
    """A progress bar on a terminal, an occasional line elsewhere.

    Args:
        epochs: Most epochs there can be.
        console: Where to print.
    """

    def __init__(self, epochs: int, console: Console) -> None:
        self.epochs = epochs
        self.console = console
        self.best = 0.0
        self.next_line = 0.0
        columns = (TextColumn("epoch"), MofNCompleteColumn(), BarColumn(), TextColumn("{task.description}"))
        self.bar = Progress(*columns, TimeElapsedColumn(), console=console, transient=True)
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

    def on_fit_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Take the bar away."""
        self._take_away()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """Take the bar away, so that the message stands alone."""
        self._take_away()

    def _take_away(self) -> None:
        if self.console.is_terminal:
            self.bar.stop()
