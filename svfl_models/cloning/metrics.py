"""Callbacks that write down and show how a cloning goes; what was written survives an interruption."""

import time
from pathlib import Path
from typing import Any

import lightning.pytorch as pl

from svfl_models.training import progress
from svfl_models.training.progress import QUIET_SECONDS, ProgressLine

COLUMNS = (
    "epoch", "train_loss", "valid_loss", "valid_gripper", "valid_xy_mm", "valid_z_mm", "valid_turn_deg", "seconds",
)  # fmt: skip


class MetricsFile(progress.MetricsFile):
    """The same rows in the checkpoint, from which a training that continues takes them.

    Args:
        path: CSV file to write.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, COLUMNS)

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on where a checkpoint was made."""
        self.rows = list(state_dict["rows"])


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
