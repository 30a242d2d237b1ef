"""Lightning callbacks that record the metrics of a training and show its progress."""

import csv
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from rich.console import Console

from svfl_data.system.progress.bars import Bars
from svfl_models.training.writing import write_rows

COLUMNS = ("epoch", "train_loss", "train_accuracy", "test_loss", "test_accuracy", "valid_accuracy", "seconds")
QUIET_SECONDS = 10.0
"""Shortest time between two lines of progress where the output is not a terminal, [s]."""

History = list[dict[str, float]]


class MetricsFile(pl.Callback):
    """Callback that writes a CSV file with one row per epoch, on disk as soon as the epoch is over.

    Test metrics are left empty in epochs without a validation.

    Args:
        path: CSV file to write.
        columns: Names of the metrics to write; ``seconds`` is the time since the start of the training.
        rows: Rows of an interrupted training that this one continues.

    Attributes:
        rows: The rows that have been written so far.
    """

    def __init__(self, path: Path, columns: Sequence[str] = COLUMNS, rows: Iterable[dict[str, float]] = ()) -> None:
        self.path, self.columns = path, tuple(columns)
        self.rows: History = list(rows)
        self.start = 0.0

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the clock, and write the header and the earlier rows to the file."""
        self.start = time.monotonic() - (self.rows[-1]["seconds"] if self.rows else 0.0)
        write_rows(self.path, [self.columns, *map(self._words, self.rows)])

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Append the row of the epoch that has ended."""
        every = trainer.check_val_every_n_epoch or 1
        tested = trainer.current_epoch % every == every - 1
        figures = {
            name: float(value)
            for name, value in trainer.callback_metrics.items()
            if name in self.columns and (tested or name.startswith("train"))  # else it is an earlier epoch's
        }
        seconds = round(time.monotonic() - self.start, 2)
        self.rows.append(self.place(trainer, pl_module) | {"seconds": seconds} | figures)
        with self.path.open("a", newline="") as file:
            csv.writer(file).writerow(self._words(self.rows[-1]))

    def place(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> dict[str, float]:
        """Return the columns that say to which point of the training a row belongs: here the epoch."""
        return {"epoch": trainer.current_epoch}

    def _words(self, row: dict[str, float]) -> list[str]:
        return [f"{row[name]:.6g}" if name in row else "" for name in self.columns]


class KeptMetrics(MetricsFile):
    """Metrics file whose rows are also kept in the checkpoint, for a training that Lightning resumes from it."""

    def state_dict(self) -> dict[str, Any]:
        """Return the rows so far, for the checkpoint."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the rows from a checkpoint."""
        self.rows = list(state_dict["rows"])


class Bar(pl.Callback):
    """Callback that removes a progress bar when its training ends, for whatever reason.

    A bar is shown if the console is a terminal; a subclass starts and updates it.

    Args:
        doing: Name of what is counted.
        total: Number of them.
        console: Console that the bar is shown on.
    """

    def __init__(self, doing: str, total: int, console: Console) -> None:
        self.bars = Bars(console)
        self.console = self.bars.console
        self.bar = self.bars.add(doing, total)

    def on_fit_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Remove the bar."""
        self._take_away()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """Remove the bar, so that only the error message is left."""
        self._take_away()

    def _take_away(self) -> None:
        self.bars.stop()


class ProgressLine(Bar):
    """Callback that shows a progress bar on a terminal, and prints an occasional line elsewhere.

    Args:
        epochs: Largest number of epochs that the training can have.
        console: Console to print on.
    """

    def __init__(self, epochs: int, console: Console) -> None:
        super().__init__("epoch", epochs, console)
        self.epochs = epochs
        self.best = 0.0
        self.next_line = 0.0

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the bar, if the console is a terminal."""
        self.next_line = time.monotonic() + QUIET_SECONDS
        self.bars.start()

    def state_dict(self) -> dict[str, Any]:
        """Return the best accuracy so far, for the checkpoint."""
        return {"best": self.best}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the best accuracy from a checkpoint."""
        self.best = float(state_dict["best"])

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the loss of the epoch that has ended, and the accuracy of the last test if there was one."""
        metrics = trainer.callback_metrics
        words = f"loss {float(metrics['train_loss']):.3f}"
        if "test_accuracy" in metrics:
            accuracy = float(metrics["test_accuracy"])
            self.best = max(self.best, accuracy)
            words += f", test accuracy {accuracy:.1%}, best {self.best:.1%}"
        self.say(trainer.current_epoch + 1, words)

    def say(self, epoch: int, words: str) -> None:
        """Show what an epoch has given.

        Args:
            epoch: Number of epochs that are over.
            words: What the last one has given.
        """
        if self.bars.shown:
            self.bars.update(self.bar, completed=epoch, words=words)
        elif time.monotonic() >= self.next_line:
            self.console.print(f"epoch {epoch}/{self.epochs}: {words}", highlight=False)
            self.next_line = time.monotonic() + QUIET_SECONDS
