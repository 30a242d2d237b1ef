"""Callbacks that write down and show how a cloning goes; what was written survives an interruption."""

import csv
import time
from pathlib import Path
from typing import Any

import lightning.pytorch as pl

from svfl_models.progress import QUIET_SECONDS, History, ProgressLine

COLUMNS = (
    "epoch", "train_loss", "valid_loss", "valid_gripper", "valid_xy_mm", "valid_z_mm", "valid_turn_deg", "seconds",
)  # fmt: skip


class MetricsFile(pl.Callback):
    """One row per epoch, on disk as soon as the epoch is over, and in the checkpoint.

    Args:
        path: CSV file to write.

    Attributes:
        rows: The rows so far, those of a training that this one continues included.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: History = []
        self.start = 0.0

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on where a checkpoint was made."""
        self.rows = list(state_dict["rows"])

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the clock and the file."""
        self.start = time.monotonic() - (self.rows[-1]["seconds"] if self.rows else 0.0)
        with self.path.open("w", newline="") as file:
            csv.writer(file).writerows([COLUMNS, *map(_words, self.rows)])

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Append a row."""
        found = {name: float(value) for name, value in trainer.callback_metrics.items() if name in COLUMNS}
        row = found | {"epoch": float(trainer.current_epoch), "seconds": round(time.monotonic() - self.start, 2)}
        self.rows.append(row)
        with self.path.open("a", newline="") as file:
            csv.writer(file).writerow(_words(row))


class CloningProgress(ProgressLine):
    """A progress bar on a terminal, an occasional line elsewhere, with what matters here."""

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the epoch's figures."""
        metrics, epoch = trainer.callback_metrics, trainer.current_epoch + 1
        words = ", ".join(
            (
                f"loss {float(metrics['train_loss']):.3f}",
                f"held out {float(metrics['valid_loss']):.3f}",
                f"{float(metrics['valid_xy_mm']):.1f} mm",
            )
        )
        if self.console.is_terminal:
            self.bar.update(self.task, completed=epoch, description=words)
        elif time.monotonic() >= self.next_line:
            self.console.print(f"epoch {epoch}/{self.epochs}: {words}", highlight=False)
            self.next_line = time.monotonic() + QUIET_SECONDS


def _words(row: dict[str, float]) -> list[str]:
    return [f"{row[name]:.6g}" if name in row else "" for name in COLUMNS]
