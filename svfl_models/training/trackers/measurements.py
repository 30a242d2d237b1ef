"""Lightning callback that measures a training and logs it to trackers; without trackers it is not used."""

import time

import lightning.pytorch as pl
import torch
from torch.optim import Optimizer

from svfl_models.training.progress import MetricsFile
from svfl_models.training.trackers.trackers import Trackers

EVERY = 10
"""Steps between two measurements within an epoch. The last step of an epoch is measured as well."""


class Measurements(pl.Callback):
    """Logs learning rates, gradient norm, loss and time per step during an epoch, and its metrics at the end.

    ``batch_loss`` is the loss of one batch, in a training of several processes that of this process's share of it.
    ``gradient_norm`` is the Euclidean norm of all gradients of a step. ``seconds_per_step`` is the mean time of the
    steps since the last measurement, with the preparation of their batches but without validation and checkpoints.

    Args:
        trackers: Trackers to log to.
        metrics: Callback of the metrics file, which is called before this one.
    """

    def __init__(self, trackers: Trackers, metrics: MetricsFile) -> None:
        self._trackers, self._metrics = trackers, metrics
        self._gradient_norm: torch.Tensor | None = None
        self._start, self._steps = 0.0, 0

    def on_train_epoch_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Start the clock."""
        self._start, self._steps = time.monotonic(), 0

    def on_before_optimizer_step(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, optimizer: Optimizer
    ) -> None:
        """Measure the gradients of a step that is logged."""
        if _is_logged(trainer):
            gradients = [one.grad for one in pl_module.parameters() if one.grad is not None]
            self._gradient_norm = torch.nn.utils.get_total_norm(gradients)

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, outputs: object, *_: object
    ) -> None:
        """Log the measurements of a step."""
        self._steps += 1
        if self._gradient_norm is None:
            return
        values = {"gradient_norm": float(self._gradient_norm)}
        if isinstance(outputs, dict):
            values["batch_loss"] = float(outputs["loss"])
        values["seconds_per_step"] = (time.monotonic() - self._start) / self._steps
        for number, group in enumerate(trainer.optimizers[0].param_groups):
            values[f"learning_rate_{number}" if number else "learning_rate"] = group["lr"]
        self._trackers.numbers(values, trainer.global_step)
        self._gradient_norm = None
        self._start, self._steps = time.monotonic(), 0

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Log the row that the metrics file has got."""
        row = {name: value for name, value in self._metrics.rows[-1].items() if name not in ("step", "seconds")}
        self._trackers.numbers(row, trainer.global_step)


def _is_logged(trainer: pl.Trainer) -> bool:
    return trainer.global_step % EVERY == 0 or trainer.is_last_batch
