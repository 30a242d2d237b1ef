"""A training that takes no time: a linear map in float64 and plain gradient descent, which hardly round."""

import os
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import lightning.pytorch as pl
import torch
from torch.utils.data import BatchSampler, DataLoader, Dataset, RandomSampler

from svfl_data.errors import TrainingError
from svfl_models.training.hardware import Hardware, Needs
from svfl_models.training.placement import placed
from svfl_models.training.progress import MetricsFile
from svfl_models.training.trainer import run

COLUMNS = ("epoch", "train_loss", "valid_loss", "seconds")


class Rows(Dataset):
    """Points with random noise that is drawn anew whenever a batch is made, as images are cropped."""

    def __init__(self, rows: int) -> None:
        self.points = torch.linspace(-1, 1, 3 * rows, dtype=torch.float64).reshape(rows, 3)

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, keys: list[int]) -> dict[str, torch.Tensor]:
        points = self.points[keys] + 0.1 * torch.randn(len(keys), 3, dtype=torch.float64)
        return {"point": points, "value": points.sum(dim=1, keepdim=True).sin()}


class SmallData(pl.LightningDataModule):
    """Shuffled batches to train on, and one batch to validate on."""

    def __init__(self, rows: int, batch_size: int) -> None:
        super().__init__()
        self.rows, self.batch_size = Rows(rows), batch_size

    def train_dataloader(self) -> DataLoader:
        return DataLoader(
            self.rows, sampler=BatchSampler(RandomSampler(self.rows), self.batch_size, False), batch_size=None
        )

    def val_dataloader(self) -> DataLoader:
        return DataLoader(self.rows, sampler=[list(range(len(self.rows)))], batch_size=None)


class SmallModule(pl.LightningModule):
    """Squared error of a linear map."""

    def __init__(self) -> None:
        super().__init__()
        self.map = torch.nn.Linear(3, 1).double()

    def training_step(self, batch: dict[str, torch.Tensor], index: int) -> torch.Tensor:
        return self._loss(batch, "train")

    def validation_step(self, batch: dict[str, torch.Tensor], index: int) -> None:
        self._loss(batch, "valid")

    def _loss(self, batch: dict[str, torch.Tensor], stage: str) -> torch.Tensor:
        loss = (self.map(batch["point"]) - batch["value"]).square().mean()
        rows = len(batch["point"])
        self.log(f"{stage}_loss", loss, on_step=False, on_epoch=True, batch_size=rows, sync_dist=True)
        return loss

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)


class Failing(SmallModule):
    """Does something in the second step of process number 1, and only there."""

    def __init__(self, act: Callable[[], None]) -> None:
        super().__init__()
        self.act = act

    def training_step(self, batch: dict[str, torch.Tensor], index: int) -> torch.Tensor:
        if self.global_rank == 1 and self.global_step == 1:
            self.act()
        return super().training_step(batch, index)


def diverge() -> None:
    """Raise what a training raises that diverges."""
    raise TrainingError("the loss of process 1 became nan")


def die() -> None:
    """Die without a word, as for want of memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def built(rows: int, batch_size: int, act: Callable[[], None] | None = None) -> tuple[SmallModule, SmallData]:
    """Build the module and the data, the same in every process."""
    pl.seed_everything(3, verbose=False)
    module = SmallModule() if act is None else Failing(act)
    return module, SmallData(rows, batch_size)


def trained(
    out: Path,
    processes: int,
    rows: int = 9,
    batch_size: int = 4,
    epochs: int = 2,
    act: Callable[[], None] | None = None,
) -> tuple[SmallModule, list[dict[str, float]]]:
    """Train in as many processes; the module and the rows of the metrics file."""
    out.mkdir(exist_ok=True)
    build = partial(built, rows, batch_size, act)
    module, data = build()
    metrics = MetricsFile(out / "metrics.csv", COLUMNS)
    placement = placed(Hardware("cpu", devices=processes), Needs())
    run(module, data, out, [metrics], placement=placement, rebuild=build, max_epochs=epochs)
    return module, metrics.rows
