"""Training step of latent pretraining."""

from typing import Any

import lightning.pytorch as pl
import numpy as np
import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_models.latent.config import TERMS
from svfl_models.latent.losses import Objective
from svfl_models.latent.networks.network import LatentNetwork
from svfl_models.latent.networks.portion import Portion
from svfl_models.symmetry.actions import Batch
from svfl_models.training.schedules import scheduler

FORMAT = "svfl-latent"
FORMAT_VERSION = "1.0"


class LatentModule(pl.LightningModule):
    """`LatentNetwork` with its `Objective` and Adam; right and wrong pairs are learned from in the same step.

    Everything random in a step depends only on the seed and on the number of the step, not on earlier steps. A training
    that is resumed from a checkpoint therefore gives the same result, bit for bit, as an uninterrupted one.

    Args:
        network: Arguments of `LatentNetwork`, plain values.
        objective: Arguments of `Objective`, plain values.
        learning_rate: Learning rate of Adam at the start of the training.
        seed: Seed of everything random in a step.
        training: The whole configuration of the training in plain values, which is only kept in the checkpoint. None if
            there is none.
        split: Indices of the episodes of each part of the data, which are only kept in the checkpoint.
        schedule: Course of the learning rate, one of `schedules.SCHEDULES`.
        length: Number of optimiser steps of the whole training, over which the learning rate takes its course.
    """

    def __init__(
        self,
        network: dict[str, Any],
        objective: dict[str, Any],
        learning_rate: float = 1e-4,
        seed: int = 0,
        training: dict[str, Any] | None = None,
        split: dict[str, list[int]] | None = None,
        schedule: str = "constant",
        length: int = 10_000,
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        self.network = LatentNetwork(**network)
        self.objective = Objective(**objective)
        self.learning_rate, self.seed = learning_rate, seed
        self.schedule, self.length = schedule, length
        self.earlier_steps = 0
        self.portion: Portion | None = None
        self.earlier_optimisation: tuple[dict[str, Any], dict[str, Any]] | None = None

    @property
    def steps(self) -> int:
        """Number of optimiser steps so far, including those of interrupted runs."""
        return self.earlier_steps + self.global_step

    def go_on(self, checkpoint: dict[str, Any]) -> None:
        """Resume the training of a checkpoint: restore weights, number of steps, Adam and learning rate.

        Lightning's own way of resuming would also restore the counters of its loops, and would begin by ending the leg
        that is already complete.

        Args:
            checkpoint: Content of the checkpoint, as `checkpoint.read_latent` returns it.
        """
        self.load_state_dict(checkpoint["state_dict"])
        self.earlier_steps = checkpoint["svfl"]["steps"]
        self.earlier_optimisation = checkpoint["optimizer_states"][0], checkpoint["lr_schedulers"][0]

    def take_rows(self, rows: slice, whole: int) -> None:
        """Note which sequences of the next batch, of `whole` sequences, this process of several computes."""
        self.portion = Portion(rows.start, rows.stop, whole)

    def on_train_batch_start(self, batch: Batch, batch_index: int) -> None:
        """Seed PyTorch's random numbers from the seed and the number of the step."""
        torch.manual_seed(int(np.random.SeedSequence([self.seed, self.steps]).generate_state(1)[0]))

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """Return the loss of a training batch."""
        return self._loss(batch, "train")

    def validation_step(self, batch: Batch, batch_index: int) -> None:
        """Log the loss of held-out sequences; latent variables have their means instead of random draws."""
        torch.manual_seed(batch_index)  # the same mismatched pairs in every validation
        self._loss(batch, "valid")

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return Adam with a learning rate that takes its course, both in the state of the checkpoint after `go_on`."""
        adam = torch.optim.Adam(self.parameters(), lr=self.learning_rate, fused=True)
        course = scheduler(adam, self.schedule, self.length)
        if self.earlier_optimisation is not None:
            of_adam, of_course = self.earlier_optimisation
            adam.load_state_dict(of_adam)
            course.load_state_dict(of_course)
        return {"optimizer": adam, "lr_scheduler": {"scheduler": course, "interval": "step"}}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Mark the checkpoint with its format, its format version and the number of steps."""
        checkpoint["svfl"] = {"format": FORMAT, "format_version": FORMAT_VERSION, "steps": self.steps}

    def _loss(self, batch: Batch, stage: str) -> Tensor:
        terms = self.objective.terms(self.network, batch, self.portion)
        weighted = {name: self.objective.weighted(name, term) for name, term in terms.items()}
        loss = torch.stack(list(weighted.values())).sum()
        if not torch.isfinite(loss):
            bad = [name for name, term in terms.items() if not torch.isfinite(term.mean)]
            raise TrainingError(
                f"the {stage} loss is not finite after {self.steps} steps ({', '.join(bad) or 'only the sum'}): "
                f"the training diverged; try a smaller learning rate than {self.learning_rate:g}"
            )
        figures = {"loss": loss} | {name: term.mean for name, term in terms.items()}
        figures |= {f"{name}_weighted": value for name, value in weighted.items()}
        named = {f"{stage}_{name}": value for name, value in figures.items()}
        rows = len(batch["episode"]) if self.portion is None else self.portion.stop - self.portion.start
        self.log_dict(named, on_step=False, on_epoch=True, sync_dist=True, batch_size=rows)
        return loss


def columns() -> list[str]:
    """Return the column names of the metrics file: each term per element, and as it enters the loss."""
    names = ["loss", *TERMS, *(f"{name}_weighted" for name in TERMS)]
    return ["step", "seconds", *(f"{stage}_{name}" for stage in ("train", "valid") for name in names)]
