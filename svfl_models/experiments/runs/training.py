"""One block-centering training of an experiment: its name, and how a worker does the training."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from svfl_data.errors import TrainingError
from svfl_models.centering.config import TrainingConfig
from svfl_models.experiments.runs.cost import cost
from svfl_models.experiments.runs.folder import finished
from svfl_models.training import run_folder

PROGRAM = "centering"
"""Name of the command that does such a training alone."""
Train = Callable[[TrainingConfig, Path, Path | None], object]
"""A function that trains one network; it takes the configuration, the folder to write to and the separate test set."""


def train(config: TrainingConfig, out: Path, separate_test: Path | None) -> None:
    """Train one network on one thread, without any output on the terminal.

    Args:
        config: Configuration of the training.
        out: Folder of the run.
        separate_test: Dataset that the network is tested on, in addition to the test split; None if there is none.

    Raises:
        SvflError: If the network cannot be trained, or a file cannot be written.
    """
    import torch
    from rich.console import Console

    from svfl_models.centering.train import train_centering

    torch.set_num_threads(1)
    train_centering(config, out, separate_test, Console(quiet=True))


def run_name(config: TrainingConfig, base: TrainingConfig) -> str:
    """Return the name of a run within its experiment, which is also the name of its folder.

    The name consists of the encoder, the group, the number of training samples, the settings in which the run deviates
    from the recipe, and the seed.

    Args:
        config: Configuration of the run.
        base: Recipe of the experiment.
    """
    if config.latent:  # the name of the latent encoder implies the other settings
        return f"{config.latent}_{config.train_samples}_seed{config.seed}"
    usual = ("encoder", "group", "train_samples", "seed")
    others = [name for name, value in config.plain().items() if name not in usual and value != getattr(base, name)]
    special = [f"{name}-{getattr(config, name)}" for name in others]
    return "_".join([config.encoder, config.group, str(config.train_samples), *special, f"seed{config.seed}"])


@dataclass(frozen=True)
class Training:
    """A run of an experiment, as a `worker.Job`.

    Attributes:
        config: Configuration of the training.
        folder: Folder of the run.
        separate_test: Dataset that the network is tested on, in addition to the test split; None if there is none.
        train: Function that trains the network; tests replace it.
    """

    config: TrainingConfig
    folder: Path
    separate_test: Path | None = None
    train: Train = train

    @property
    def cost(self) -> float:
        """Estimated duration of the run in arbitrary units, see `runs.cost.cost`."""
        return cost(self.config)

    def words(self) -> str | None:
        """Return the test accuracy of the network in words, or None if the run is not finished.

        Raises:
            TrainingError: If the folder holds a finished run with another configuration.
        """
        found = finished(self.folder)
        if found is None:
            return None
        if found["config"] != self.config.plain():
            raise TrainingError(f"{self.folder} holds a run with another configuration; choose another --out")
        return f"test accuracy {found['result']['test_accuracy']:.1%}"

    def __call__(self) -> None:
        """Train the network; an interrupted training of the same configuration continues after its last whole epoch."""
        if self.folder.exists() and not self._begun():
            shutil.rmtree(self.folder)
        self.train(self.config, self.folder, self.separate_test)

    def _begun(self) -> bool:
        """Return whether the folder holds a run of the same configuration, which may be continued."""
        try:
            found = run_folder.read_config(self.folder)
        except TrainingError:
            return False
        return found is not None and run_folder.is_same(found, PROGRAM, self.config.plain())
