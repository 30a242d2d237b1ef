"""Train a policy on demonstrations: load, split, fit; an interrupted training goes on where it was."""

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import lightning.pytorch as pl
import torch
from rich.console import Console

from svfl_data.errors import FormatError
from svfl_data.system.side_files import read_json
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.metrics import CloningProgress, MetricsFile
from svfl_models.cloning.module import CloningModule
from svfl_models.networks.presets import THREADS
from svfl_models.training import run_folder
from svfl_models.training.trainer import parameter_count, run, storage_errors
from svfl_models.training.writing import write_json


@dataclass(frozen=True)
class Result:
    """Outcome of a training; errors are those of the last epoch on the held-out episodes (`module.errors`).

    Attributes:
        train_loss: Of the last epoch.
        valid_loss: The same on the held-out episodes.
        valid_gripper: Share of the gripper's openings that were wrong, 0..1.
        valid_xy_mm: Mean distance between said and demonstrated (dx, dy), [mm].
        valid_z_mm: The same of dz, [mm].
        valid_turn_deg: The same of dtheta, [deg].
        episodes: Episodes learned from and held out.
        steps: Steps in them.
        epochs: Epochs trained.
        seconds: Time of the training, without imports and loading.
        parameters: Learned numbers of the network.
    """

    train_loss: float
    valid_loss: float
    valid_gripper: float
    valid_xy_mm: float
    valid_z_mm: float
    valid_turn_deg: float
    episodes: list[int]
    steps: list[int]
    epochs: int
    seconds: float
    parameters: int


def train_cloning(config: CloningConfig, out: Path, console: Console | None = None) -> Result:
    """Train one policy; the same configuration gives the same weights on the same machine, interrupted or not.

    The weights are those of the last epoch: the loss on held-out episodes says little about success (Mandlekar et al.,
    CoRL 2021), so nothing is chosen by it.

    Args:
        config: What to train, on what.
        out: Folder for checkpoint, metrics and result. A training of the same configuration that was interrupted there
            goes on after its last whole epoch.
        console: Where progress goes; standard output by default.

    Returns:
        The outcome, as it is also written to ``result.json``.

    Raises:
        SvflError: If the data, the configuration or the folder cannot serve, or the training diverges.
        KeyboardInterrupt: If the user stopped the training; the last whole epoch is in ``checkpoint.ckpt``.

    Example:
        >>> from pathlib import Path
        >>> config = CloningConfig("data/block_picking", episodes=50)
        >>> train_cloning(config, Path("out/bc"))  # doctest: +SKIP
    """
    torch.set_num_threads(min(torch.get_num_threads(), THREADS.get(config.preset, 1)))
    data = CloningData(config)
    pl.seed_everything(config.seed, verbose=False)
    steps = config.epochs * math.ceil(len(data.train_set) / config.batch_size)
    module = CloningModule(
        config.network(), data.deployment.plain(), config.view, config.loss, config.learning_rate, steps, config.plain()
    )
    typical = data.train_set.typical()
    module.policy.trunk.normalization.fit(
        **{name: typical[name].numpy() for name in ("image", "wrench", "proprio") if name in typical}
    )
    with run_folder.held(out), storage_errors(out):
        resumed = _interrupted(config, out)
        if resumed is None:
            run_folder.claim(out, config.plain())
        metrics = MetricsFile(out / run_folder.METRICS)
        watching = [metrics, CloningProgress(config.epochs, console or Console())]
        run(module, data, out, watching, resumed, max_epochs=config.epochs)
        last = metrics.rows[-1]
        result = Result(
            **{name: last[name] for name in Result.__annotations__ if name in last and name != "seconds"},
            episodes=[len(part.samples.episodes) for part in (data.train_set, data.valid_set)],
            steps=[len(data.train_set), len(data.valid_set)],
            epochs=len(metrics.rows),
            seconds=last["seconds"],
            parameters=parameter_count(module),
        )
        content = {"config": config.plain(), "deployment": data.deployment.plain(), "result": asdict(result)}
        write_json(out / run_folder.RESULT, content)
    return result


def _interrupted(config: CloningConfig, out: Path) -> Path | None:
    """The checkpoint of a training of the same configuration that has not come to its end, if there is one."""
    checkpoint = out / run_folder.CHECKPOINT
    if not checkpoint.exists() or (out / run_folder.RESULT).exists():
        return None
    try:
        same = read_json(out / run_folder.CONFIG) == config.plain()
    except (OSError, FormatError):
        return None  # `run_folder.claim` says what is wrong
    if same:
        load_policy(checkpoint)  # a damaged one is said before the training starts
    return checkpoint if same else None
