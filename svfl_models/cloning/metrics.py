"""Callbacks that record and show the progress of a behaviour cloning run; the records survive an interruption."""

from pathlib import Path
from typing import Any

import lightning.pytorch as pl

from svfl_models.training import progress
from svfl_models.training.progress import ProgressLine

COLUMNS = (
    "epoch", "train_loss", "valid_loss", "valid_error", "valid_gripper", "valid_xy_mm", "valid_z_mm", "valid_turn_deg",
    "seconds",
)  # fmt: skip


class MetricsFile(progress.MetricsFile):
    """CSV file with one row of metrics per epoch, whose rows are also kept in the checkpoint for a resumed training.

    Args:
        path: CSV file to write.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, COLUMNS)

    def state_dict(self) -> dict[str, Any]:
        """Return the rows so far, for the checkpoint."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the rows from a checkpoint."""
        self.rows = list(state_dict["rows"])


class CloningProgress(ProgressLine):
    """Progress display of a training: a bar on a terminal, otherwise a line every `QUIET_SECONDS`."""

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Show the losses and the position error of the epoch."""
        metrics = trainer.callback_metrics
        words = ", ".join(
            (
                f"loss {float(metrics['train_loss']):.3f}",
                f"held out {float(metrics['valid_loss']):.3f}",
                f"{float(metrics['valid_xy_mm']):.1f} mm"
                if "valid_xy_mm" in metrics
                else f"error {float(metrics['valid_error']):.1%}",
            )
        )
        self.say(trainer.current_epoch + 1, words)
