"""The training step of block centering."""

from typing import Any

import lightning.pytorch as pl
import torch
from torch import Tensor
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.classifier import Batch, CenteringClassifier


class CenteringModule(pl.LightningModule):
    """Cross-entropy and Adam around a `CenteringClassifier` (Kohler et al., CoRL 2023, appendix: learning rate 1e-3).

    A checkpoint holds the configuration and the normalisation with the weights:
    ``CenteringModule.load_from_checkpoint(path).classifier`` is ready for use.

    Args:
        network: Arguments of `CenteringClassifier`.
        learning_rate: Of Adam.
        training: The rest of the training's configuration, plain values, kept for whoever opens the checkpoint.
    """

    def __init__(
        self, network: dict[str, Any], learning_rate: float = 1e-3, training: dict[str, Any] | None = None
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        self.classifier = CenteringClassifier(**network)
        self.learning_rate = learning_rate

    def forward(self, batch: Batch) -> Tensor:
        """Scores of the four directions, shape (B, 4)."""
        return self.classifier(batch)

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """Loss of a batch."""
        return self._loss(batch, "train")

    def validation_step(self, batch: Batch, batch_index: int) -> None:
        """Loss and accuracy on the test samples."""
        self._loss(batch, "test")

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam."""
        return torch.optim.Adam(self.parameters(), lr=self.learning_rate)

    def _loss(self, batch: Batch, stage: str) -> Tensor:
        scores, direction = self(batch), batch["direction"]
        loss = functional.cross_entropy(scores, direction)
        if not torch.isfinite(loss):
            raise TrainingError(
                f"the {stage} loss became {loss.item()} in epoch {self.current_epoch}: the training diverged; "
                f"try a smaller learning rate than {self.learning_rate}"
            )
        correct = (scores.argmax(dim=1) == direction).float().mean()
        of_epoch: dict[str, Any] = {"on_step": False, "on_epoch": True, "batch_size": len(direction)}
        self.log_dict({f"{stage}_loss": loss, f"{stage}_accuracy": correct}, **of_epoch)
        return loss
