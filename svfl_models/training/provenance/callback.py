"""Lightning callback that records the provenance of a training in its folder and in its checkpoints."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
import torch

from svfl_models.training.provenance.record import KEY, plain, record
from svfl_models.training.provenance.session import DataRecord, Session, session


class ProvenanceRecord(pl.Callback):
    """Callback that adds a session to those of the run's folder when the training starts, and all to each checkpoint.

    Args:
        out: Folder of the run.
        data: Datasets and files that the training reads, by the option that names them.
        seeds: Seeds of everything random.

    Attributes:
        sessions: Sessions of the run, oldest first; empty before the training starts.
    """

    def __init__(self, out: Path, data: Mapping[str, DataRecord], seeds: Sequence[int]) -> None:
        self.out, self.data, self.seeds = out, data, seeds
        self.sessions: list[Session] = []

    def on_fit_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Record this session, whose device is known now."""
        if trainer.is_global_zero:
            self.sessions = record(self.out, session(self.data, self.seeds, device_name(trainer.strategy.root_device)))

    def on_save_checkpoint(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Put the sessions into a checkpoint."""
        checkpoint[KEY] = plain(self.sessions)


def device_name(device: torch.device) -> str | None:
    """Return the name of a GPU, or None for the processor.

    Args:
        device: Device of PyTorch.
    """
    if device.type == "cpu":
        return None
    return torch.cuda.get_device_name(device) if device.type == "cuda" else str(device)
