"""Metrics of a behaviour cloning run, and the callback that shows them."""

import lightning.pytorch as pl

from svfl_models.training.progress import ProgressLine

COLUMNS = (
    "epoch", "train_loss", "valid_loss", "valid_error", "valid_gripper", "valid_xy_mm", "valid_z_mm", "valid_turn_deg",
    "seconds",
)  # fmt: skip


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
