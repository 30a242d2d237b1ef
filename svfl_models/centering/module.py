"""Training step of block centering."""

from typing import Any

import lightning.pytorch as pl
import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.networks.heads import OffsetHead
from svfl_models.symmetry.actions import Batch
from svfl_models.training.schedules import scheduler

FORMAT = "svfl-centering"
FORMAT_VERSION = "1.0"


class CenteringModule(pl.LightningModule):
    """Loss and Adam for a `CenteringClassifier` (Kohler et al., CoRL 2023, appendix: cross-entropy, rate 1e-3).

    For offsets the loss is the squared error in units of the training offsets' root mean square. A checkpoint holds the
    configuration and the normalisation together with the weights; `checkpoint.load_classifier` opens it.

    Args:
        network: Arguments of `CenteringClassifier`, plain values.
        learning_rate: Learning rate of Adam at the start of the training.
        epochs: Number of epochs of the training, over which the learning rate takes its course.
        training: The whole configuration of the training in plain values, which is only kept in the checkpoint. None if
            there is none.
        trunk_rate: Learning rate of the trunk at the start. 0 leaves the trunk's weights unchanged; None gives the
            trunk the same rate as the head.
        schedule: Course of the learning rate, one of `schedules.SCHEDULES`.
    """

    def __init__(
        self,
        network: dict[str, Any],
        learning_rate: float = 1e-3,
        epochs: int = 500,
        training: dict[str, Any] | None = None,
        trunk_rate: float | None = None,
        schedule: str = "cosine",
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        self.classifier = CenteringClassifier(**network)
        self.learning_rate, self.epochs, self.trunk_rate, self.schedule = learning_rate, epochs, trunk_rate, schedule
        if self.frozen:
            self.classifier.trunk.requires_grad_(False)

    @property
    def frozen(self) -> bool:
        """Whether the trunk's weights stay unchanged and only the head is trained."""
        return self.trunk_rate == 0

    def forward(self, batch: Batch) -> Tensor:
        """Return the scores of the four directions, shape (B, 4), or the offsets, shape (B, 2), [m]."""
        return self.classifier(batch)

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """Return the loss of a training batch."""
        return self._loss(batch, "train")

    def validation_step(self, batch: Batch, batch_index: int, dataloader_idx: int = 0) -> None:
        """Log the loss and the accuracy on a batch of test samples or, of the second loader, of validation samples."""
        self._loss(batch, ("test", "valid")[dataloader_idx])

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return Adam with a learning rate that takes its course from epoch to epoch."""
        learning: Any = [parameter for parameter in self.parameters() if parameter.requires_grad]
        if self.trunk_rate:
            head, trunk = self.classifier.head.parameters(), self.classifier.trunk.parameters()
            learning = [{"params": head}, {"params": trunk, "lr": self.trunk_rate}]
        adam = torch.optim.Adam(learning, lr=self.learning_rate)
        return [adam], [scheduler(adam, self.schedule, self.epochs)]

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Mark the checkpoint with its format and format version."""
        checkpoint["svfl"] = {"format": FORMAT, "format_version": FORMAT_VERSION}

    def _loss(self, batch: Batch, stage: str) -> Tensor:
        output, direction = self(batch), batch["direction"]
        head = self.classifier.head
        if isinstance(head, OffsetHead):
            loss = functional.mse_loss(output / head.scale, batch["offset"] / head.scale)
        else:
            loss = functional.cross_entropy(output, direction)
        if not torch.isfinite(loss):
            for name, values in batch.items():
                if not torch.isfinite(values).all():
                    raise TrainingError(
                        f"{name} in a {stage} batch of epoch {self.current_epoch} holds NaN or infinity"
                    )
            raise TrainingError(
                f"the {stage} loss became {loss.item()} in epoch {self.current_epoch}: the training diverged; "
                f"try a smaller learning rate than {self.learning_rate}"
            )
        correct = (directions(output) == direction).float().mean()
        of_epoch: dict[str, Any] = {"on_step": False, "on_epoch": True, "sync_dist": True, "batch_size": len(direction)}
        of_epoch["add_dataloader_idx"] = False  # the stage names the loader
        self.log_dict({f"{stage}_loss": loss, f"{stage}_accuracy": correct}, **of_epoch)
        return loss


def directions(output: Tensor) -> Tensor:
    """Return the direction classes of scores (B, 4) or of offsets (B, 2), shape (B,)."""
    if output.shape[-1] == 4:
        return output.argmax(dim=-1)
    return (torch.atan2(output[..., 1], output[..., 0]) / (torch.pi / 2)).round().long() % 4
