"""Trains a policy on demonstrations: loads, splits and fits; an interrupted training can be resumed."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from rich.console import Console

from svfl_data.system.progress import progress_console
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.metrics import COLUMNS, CloningProgress
from svfl_models.cloning.module import CloningModule
from svfl_models.cloning.recorded_inputs import of_plain
from svfl_models.cloning.report import Result, write_report
from svfl_models.networks.input_types import plain_inputs
from svfl_models.training import run_folder
from svfl_models.training.hardware import Hardware, needs_of
from svfl_models.training.placement import placed
from svfl_models.training.progress import KeptMetrics
from svfl_models.training.provenance.callback import ProvenanceRecord
from svfl_models.training.provenance.session import dataset
from svfl_models.training.run_settings import settings_of_run
from svfl_models.training.trackers.names import check_trackers
from svfl_models.training.trackers.trackers import opened
from svfl_models.training.trainer import parameter_count, run, storage_errors
from svfl_models.training.writing import write_json

PROGRAM = "bc"


def train_cloning(
    config: CloningConfig,
    out: Path,
    console: Console | None = None,
    *,
    hardware: Hardware = Hardware(),  # noqa: B008 - a value, frozen
    loggers: Sequence[str] = (),
) -> Result:
    """Train one policy; the same configuration gives the same weights on the same machine, interrupted or not.

    The final weights are those of the last epoch. No weights are chosen by the loss on the held-out episodes, because
    it says little about the success of a policy (Mandlekar et al., CoRL 2021).

    Args:
        config: Configuration of the policy, the demonstrations and the training.
        out: Folder for the checkpoint, metrics, result, learning curves and report. If it holds an interrupted training
            of the same configuration, that training is resumed after its last complete epoch.
        console: Console that progress is shown on; standard error by default.
        hardware: Devices, number format and threads. Several processes give the result of one, apart from rounding.
        loggers: Names of experiment trackers to log to, beside the metrics file (`training.trackers`).

    Returns:
        The outcome, which is also written to ``result.json``.

    Raises:
        UsageError: If the hardware or a tracker is not there.
        SvflError: If the data, the configuration or the folder cannot be used, or the training diverges.
        KeyboardInterrupt: If the user stopped the training; ``checkpoint.ckpt`` holds the last complete epoch.

    Example:
        >>> from pathlib import Path
        >>> config = CloningConfig("data/block_picking", episodes=50)
        >>> train_cloning(config, Path("out/bc"))  # doctest: +SKIP
    """
    console = console or progress_console()
    check_trackers(loggers)
    placement = placed(hardware, needs_of(config.preset, config.group))
    placement.prepare(console)
    module, data = built(config, hardware.loader_workers)
    epochs = epochs_of(config, len(data.train_set))
    with run_folder.held(out), storage_errors(out):
        beside = settings_of_run(hardware, loggers)
        resumed = run_folder.claim_or_resume(out, PROGRAM, config.plain(), beside, load_policy)
        metrics = KeptMetrics(out / run_folder.METRICS, COLUMNS)
        provenance = ProvenanceRecord(out, {"data": dataset(config.data)}, [config.seed])
        watching = [metrics, CloningProgress(epochs, console), provenance]
        with opened(loggers, out, go_on=resumed is not None) as trackers:
            trackers.configuration(config.plain())
            run(
                module, data, out, watching, resumed, placement=placement, trackers=trackers,
                rebuild=partial(built, config, hardware.loader_workers), max_epochs=epochs,
            )  # fmt: skip
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
        write_report(out, config, data.deployment.task, result, metrics.rows, provenance.sessions)
        write_json(out / run_folder.RESULT, content | {"hardware": placement.plain()})
    return result


def built(config: CloningConfig, loader_workers: int = 0) -> tuple[CloningModule, CloningData]:
    """Load the demonstrations and build the policy; the same configuration gives the same in every process.

    Args:
        config: Configuration of the policy, the demonstrations and the training.
        loader_workers: Number of processes that prepare batches.

    Raises:
        SvflError: If the data or the configuration cannot be used.
    """
    data = CloningData(config, loader_workers)
    pl.seed_everything(config.seed, verbose=False)
    steps = epochs_of(config, len(data.train_set)) * math.ceil(len(data.train_set) / config.batch_size)
    network, deployment = network_of(config, data.deployment), data.deployment.plain()
    module = CloningModule(
        network, deployment, config.view, config.loss, config.learning_rate, steps, config.plain(), config.schedule
    )
    typical = data.train_set.typical()
    module.policy.trunk.normalization.fit(**{name: values.numpy() for name, values in typical.items()})
    return module, data


def epochs_of(config: CloningConfig, steps: int) -> int:
    """Return the number of epochs of a training.

    Args:
        config: Configuration of the training.
        steps: Number of demonstrated steps that it learns from.
    """
    return math.ceil(config.steps / math.ceil(steps / config.batch_size)) if config.steps else config.epochs


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
