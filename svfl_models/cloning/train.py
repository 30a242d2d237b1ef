"""Trains a policy on demonstrations: loads, splits and fits; an interrupted training can be resumed."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
import torch
from rich.console import Console

from svfl_data.errors import FormatError
from svfl_data.system.side_files import read_json
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.metrics import CloningProgress, MetricsFile
from svfl_models.cloning.module import CloningModule
from svfl_models.cloning.recorded_inputs import of_plain
from svfl_models.cloning.report import Result, write_report
from svfl_models.networks.input_types import plain_inputs
from svfl_models.networks.presets import THREADS
from svfl_models.training import run_folder
from svfl_models.training.trainer import parameter_count, run, storage_errors
from svfl_models.training.writing import write_json


def train_cloning(config: CloningConfig, out: Path, console: Console | None = None) -> Result:
    """Train one policy; the same configuration gives the same weights on the same machine, interrupted or not.

    The final weights are those of the last epoch. No weights are chosen by the loss on the held-out episodes, because
    it says little about the success of a policy (Mandlekar et al., CoRL 2021).

    Args:
        config: Configuration of the policy, the demonstrations and the training.
        out: Folder for the checkpoint, metrics, result, learning curves and report. If it holds an interrupted training
            of the same configuration, that training is resumed after its last complete epoch.
        console: Console that progress is printed on; standard output by default.

    Returns:
        The outcome, which is also written to ``result.json``.

    Raises:
        SvflError: If the data, the configuration or the folder cannot be used, or the training diverges.
        KeyboardInterrupt: If the user stopped the training; ``checkpoint.ckpt`` holds the last complete epoch.

    Example:
        >>> from pathlib import Path
        >>> config = CloningConfig("data/block_picking", episodes=50)
        >>> train_cloning(config, Path("out/bc"))  # doctest: +SKIP
    """
    torch.set_num_threads(min(torch.get_num_threads(), THREADS.get(config.preset, 1)))
    data = CloningData(config)
    pl.seed_everything(config.seed, verbose=False)
    steps = config.epochs * math.ceil(len(data.train_set) / config.batch_size)
    network, deployment = network_of(config, data.deployment), data.deployment.plain()
    module = CloningModule(
        network, deployment, config.view, config.loss, config.learning_rate, steps, config.plain()
    )  # fmt: skip
    typical = data.train_set.typical()
    module.policy.trunk.normalization.fit(**{name: values.numpy() for name, values in typical.items()})
    with run_folder.held(out), storage_errors(out):
        resumed = _interrupted(config, out)
        if resumed is None:
            run_folder.claim(out, config.plain())
        metrics = MetricsFile(out / run_folder.METRICS)
        watching = [metrics, CloningProgress(config.epochs, console or Console())]
        run(module, data, out, watching, resumed, max_epochs=config.epochs)
        last = metrics.rows[-1]
        absent: dict[str, Any] = dict.fromkeys(("valid_gripper", "valid_xy_mm", "valid_z_mm", "valid_turn_deg"))
        found = {name: last[name] for name in Result.__annotations__ if name in last and name != "seconds"}
        result = Result(
            **absent | found,
            episodes=[len(part.samples.episodes) for part in (data.train_set, data.valid_set)],
            steps=[len(data.train_set), len(data.valid_set)],
            epochs=len(metrics.rows),
            seconds=last["seconds"],
            parameters=parameter_count(module),
        )
        content = {"config": config.plain(), "deployment": data.deployment.plain(), "result": asdict(result)}
        write_report(out, config, data.deployment.task, result, metrics.rows)
        write_json(out / run_folder.RESULT, content)
    return result


def network_of(config: CloningConfig, deployment: DeploymentSpec) -> dict[str, Any]:
    """Return the arguments of `policy.Policy`, plain values, with the user's own inputs and action if there are any.

    Args:
        config: Configuration of the training.
        deployment: What the demonstrations have in common.
    """
    if not deployment.inputs:
        return config.network()
    inputs = plain_inputs([one.network() for one in of_plain(deployment.inputs)])
    return config.network() | {"inputs": inputs, "action": deployment.action}


def _interrupted(config: CloningConfig, out: Path) -> Path | None:
    """Return the checkpoint of an unfinished training of the same configuration, or None if there is none."""
    checkpoint = out / run_folder.CHECKPOINT
    if not checkpoint.exists() or (out / run_folder.RESULT).exists():
        return None
    try:
        same = read_json(out / run_folder.CONFIG) == config.plain()
    except (OSError, FormatError):
        return None  # `run_folder.claim` reports what is wrong
    if same:
        load_policy(checkpoint)  # reports a damaged checkpoint before the training starts
    return checkpoint if same else None
