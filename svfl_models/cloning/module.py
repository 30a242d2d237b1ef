"""The training step of behaviour cloning."""

import math
from typing import Any

import lightning.pytorch as pl
import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.loss import LOSSES
from svfl_models.networks.policy import Policy
from svfl_models.networks.squashed_gaussian import SquashedGaussian
from svfl_models.networks.visual_force import Batch

FORMAT = "svfl-policy"
FORMAT_VERSION = "1.0"


class CloningModule(pl.LightningModule):
    """Loss and Adam around a `policy.Policy`.

    A checkpoint holds the configuration, the normalisation and the deployment setup of the demonstrations with the
    weights; `cloning.checkpoint.load_policy` opens it.

    Args:
        network: Arguments of `policy.Policy`.
        deployment: The fields of `cloning.deployment.DeploymentSpec`.
        view: One of `cloning.config.VIEWS`.
        loss: One of `cloning.config.LOSSES`.
        learning_rate: Of Adam, at the start.
        steps: Over which the learning rate falls to zero along a cosine (Loshchilov & Hutter, ICLR 2017, one cycle).
        training: The rest of the training's configuration, plain values, kept for whoever opens the checkpoint.
    """

    def __init__(
        self,
        network: dict[str, Any],
        deployment: dict[str, Any],
        view: str = "gripper",
        loss: str = "action",
        learning_rate: float = 1e-3,
        steps: int = 1000,
        training: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        if loss not in LOSSES:
            raise TrainingError(f"unknown loss {loss!r}; possible: {', '.join(LOSSES)}")
        self.policy, self.deployment = Policy(**network), DeploymentSpec(**deployment)
        self.view = view
        self.loss, self.learning_rate, self.steps = LOSSES[loss], learning_rate, steps

    def forward(self, batch: Batch) -> SquashedGaussian:
        """What to do, image-aligned axes."""
        return self.policy(batch)

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """Loss of a batch."""
        return self._loss(batch, "train")

    def validation_step(self, batch: Batch, batch_index: int) -> None:
        """Loss and errors on the held-out episodes."""
        self._loss(batch, "valid")

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Adam, slower with every step."""
        adam = torch.optim.Adam(self.parameters(), lr=self.learning_rate)
        slower = torch.optim.lr_scheduler.CosineAnnealingLR(adam, self.steps)
        return {"optimizer": adam, "lr_scheduler": {"scheduler": slower, "interval": "step"}}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Say what kind of file this is."""
        checkpoint["svfl"] = {"format": FORMAT, "format_version": FORMAT_VERSION}

    def _loss(self, batch: Batch, stage: str) -> Tensor:
        said, action = self(batch), batch["action"]
        loss = self.loss(said, action).mean()
        if not torch.isfinite(loss):
            raise TrainingError(
                f"the {stage} loss became {loss.item()} in epoch {self.current_epoch}: the training diverged; "
                f"try a smaller learning rate than {self.learning_rate}"
            )
        unit = torch.from_numpy(self.deployment.unit).to(action)
        figures = {"loss": loss} | (errors(said.mode * unit, action * unit) if stage == "valid" else {})
        of_epoch: dict[str, Any] = {"on_step": False, "on_epoch": True, "batch_size": len(action)}
        self.log_dict({f"{stage}_{name}": value for name, value in figures.items()}, **of_epoch)
        return loss


def errors(said: Tensor, action: Tensor) -> dict[str, Tensor]:
    """How far actions (B, 5) are from demonstrated ones, in units that one can picture.

    Returns:
        ``gripper``, share of the openings on the wrong side of a half; ``xy_mm`` and ``z_mm``, mean distances;
        ``turn_deg``, mean angle.
    """
    off = said - action
    return {
        "gripper": ((said[:, 0] > 0.5) != (action[:, 0] > 0.5)).float().mean(),
        "xy_mm": 1000 * off[:, 1:3].norm(dim=1).mean(),
        "z_mm": 1000 * off[:, 3].abs().mean(),
        "turn_deg": off[:, 4].abs().mean() * (180 / math.pi),
    }
