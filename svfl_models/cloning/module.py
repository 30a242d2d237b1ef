"""Training step of behaviour cloning."""

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
from svfl_models.symmetry.actions import Batch
from svfl_models.training.schedules import scheduler

FORMAT = "svfl-policy"
FORMAT_VERSION = "1.0"


class CloningModule(pl.LightningModule):
    """Loss and Adam for a `policy.Policy`.

    A checkpoint holds the configuration, the normalisation and the `DeploymentSpec` of the demonstrations together with
    the weights; `cloning.checkpoint.load_policy` opens it.

    Args:
        network: Arguments of `policy.Policy`, plain values.
        deployment: Attributes of the demonstrations' `cloning.deployment_spec.DeploymentSpec`, plain values.
        view: Centre of the images, one of `cloning.config.VIEWS`: ``gripper`` or ``camera``.
        loss: Name of the loss, one of `cloning.config.LOSSES`: ``action`` or ``likelihood``.
        learning_rate: Learning rate of Adam at the start of the training.
        steps: Number of optimiser steps of the training, over which the learning rate takes its course.
        training: The whole configuration of the training in plain values, which is only kept in the checkpoint. None if
            there is none.
        schedule: Course of the learning rate, one of `schedules.SCHEDULES`.
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
        schedule: str = "cosine",
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        if loss not in LOSSES:
            raise TrainingError(f"unknown loss {loss!r}; possible: {', '.join(LOSSES)}")
        self.policy, self.deployment = Policy(**network), DeploymentSpec(**deployment)
        self.view = view
        self.loss, self.learning_rate, self.steps = LOSSES[loss], learning_rate, steps
        self.schedule = schedule

    def forward(self, batch: Batch) -> SquashedGaussian:
        """Return the policy's distribution of actions for a batch of observations, in image-aligned axes."""
        return self.policy(batch)

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """Return the loss of a training batch."""
        return self._loss(batch, "train")

    def validation_step(self, batch: Batch, batch_index: int) -> None:
        """Log the loss and the errors on a batch of the held-out episodes."""
        self._loss(batch, "valid")

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return Adam with a learning rate that takes its course from step to step."""
        adam = torch.optim.Adam(self.parameters(), lr=self.learning_rate)
        course = scheduler(adam, self.schedule, self.steps)
        return {"optimizer": adam, "lr_scheduler": {"scheduler": course, "interval": "step"}}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Mark the checkpoint with its format and format version."""
        checkpoint["svfl"] = {"format": FORMAT, "format_version": FORMAT_VERSION}

    def _loss(self, batch: Batch, stage: str) -> Tensor:
        said, action = self(batch), batch["action"]
        loss = self.loss(said, action).mean()
        if not torch.isfinite(loss):
            raise TrainingError(
                f"the {stage} loss became {loss.item()} in epoch {self.current_epoch}: the training diverged; "
                f"try a smaller learning rate than {self.learning_rate}"
            )
        figures = {"loss": loss} | (self.action_errors(said, action) if stage == "valid" else {})
        of_epoch: dict[str, Any] = {"on_step": False, "on_epoch": True, "sync_dist": True, "batch_size": len(action)}
        self.log_dict({f"{stage}_{name}": value for name, value in figures.items()}, **of_epoch)
        return loss

    def action_errors(self, said: SquashedGaussian, action: Tensor) -> dict[str, Tensor]:
        """Compute the mean errors of the policy's actions.

        Args:
            said: Distributions of the policy for B samples.
            action: Demonstrated actions, in image-aligned axes and within the bounds of the network, shape (B, C).

        Returns:
            ``error``: mean absolute error as a share of half the range between the bounds. With the paper's inputs also
            those of `errors`; with others ``gripper``, the share of the gripper openings on the wrong side of 0.5, if
            the action has one.
        """
        space, mode = said.space, said.mode
        found = {"error": (space.to_unit(mode) - space.to_unit(action)).abs().mean()}
        if not self.deployment.inputs:
            unit = torch.from_numpy(self.deployment.unit).to(action)
            return found | errors(mode * unit, action * unit)
        at = space.opening
        if at is None:
            return found
        return found | {"gripper": ((mode[:, at] > 0.5) != (action[:, at] > 0.5)).float().mean()}


def errors(said: Tensor, action: Tensor) -> dict[str, Tensor]:
    """Compute the mean errors of a policy's actions in common units.

    Args:
        said: Actions of the policy, shape (B, 5): gripper opening 0..1, dx, dy, dz [m], dtheta [rad].
        action: Demonstrated actions, with the same shape and units.

    Returns:
        ``gripper``: share of the gripper openings on the wrong side of 0.5. ``xy_mm`` and ``z_mm``: mean distance of
        (dx, dy) and of dz, [mm]. ``turn_deg``: mean absolute difference of dtheta, [deg].
    """
    off = said - action
    return {
        "gripper": ((said[:, 0] > 0.5) != (action[:, 0] > 0.5)).float().mean(),
        "xy_mm": 1000 * off[:, 1:3].norm(dim=1).mean(),
        "z_mm": 1000 * off[:, 3].abs().mean(),
        "turn_deg": off[:, 4].abs().mean() * (180 / math.pi),
    }
