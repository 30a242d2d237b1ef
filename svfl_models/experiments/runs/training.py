"""One block-centering training of an experiment: its name, and how a worker does it."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from svfl_data.errors import TrainingError
from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.runs.cost import cost
from svfl_models.experiments.runs.folder import finished

Train = Callable[[TrainingConfig, Path, Path | None], object]
"""Trains one network into a folder: configuration, folder, separate test set."""


def train(config: TrainingConfig, out: Path, separate_test: Path | None) -> None:
    """Train one network in silence."""
    import torch
    from rich.console import Console

    from svfl_models.centering.train import train_centering

    torch.set_num_threads(1)
    train_centering(config, out, separate_test, Console(quiet=True))


def run_name(config: TrainingConfig, base: TrainingConfig) -> str:
    """Name of a run within its experiment, for people and for its folder: what it deviates in, and the seed."""
    if config.latent:  # its name tells the rest
        return f"{config.latent}_{config.train_samples}_seed{config.seed}"
    usual = ("encoder", "group", "train_samples", "seed")
    others = [name for name, value in config.plain().items() if name not in usual and value != getattr(base, name)]
    special = [f"{name}-{getattr(config, name)}" for name in others]
    return "_".join([config.encoder, config.group, str(config.train_samples), *special, f"seed{config.seed}"])


@dataclass(frozen=True)
class Training:
    """A run of an experiment, as a `worker.Job`.

    Attributes:
        config: What is trained, on what.
        folder: Of the run.
        separate_test: Dataset that the network is tested on besides.
        train: Trains it; another one in tests.
    """

    config: TrainingConfig
    folder: Path
    separate_test: Path | None = None
    train: Train = train

    @property
    def cost(self) -> float:
        """About how long it takes, see `experiments.cost`."""
        return cost(self.config)

    def words(self) -> str | None:
        """How accurate the network is; None if it is not finished.

        Raises:
            TrainingError: If its folder holds a finished run with another configuration.
        """
        found = finished(self.folder)
        if found is None:
            return None
        if found["config"] != self.config.plain():
            raise TrainingError(f"{self.folder} holds a run with another configuration; choose another --out")
        return f"test accuracy {found['result']['test_accuracy']:.1%}"

    def __call__(self) -> None:
        """Train from the beginning."""
        if self.folder.exists():
            shutil.rmtree(self.folder)  # of a run that was stopped or failed
        self.train(self.config, self.folder, self.separate_test)
