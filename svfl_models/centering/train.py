"""Trains a block-centering classifier: loads and splits the samples, fits, tests and writes the report.

An interrupted training can be resumed.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import lightning.pytorch as pl
import numpy as np
import torch
from lightning.pytorch.callbacks import EarlyStopping
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.centering_samples import CenteringSamples, View, load_centering
from svfl_data.sampling.named_camera import camera_of_dataset
from svfl_data.sampling.split import train_test_split
from svfl_data.system.progress import progress_console
from svfl_models.centering.checkpoint import load_classifier
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.data import CenteringData, check_samples
from svfl_models.centering.evaluate import evaluate, write_predictions
from svfl_models.centering.module import CenteringModule
from svfl_models.centering.pretrained import module_of
from svfl_models.centering.report import Result, write_report
from svfl_models.centering.sensor_noise import with_noise
from svfl_models.networks.inputs import INPUTS
from svfl_models.training import run_folder
from svfl_models.training.hardware import Hardware, needs_of
from svfl_models.training.placement import Placement, placed
from svfl_models.training.progress import COLUMNS, KeptMetrics, ProgressLine
from svfl_models.training.provenance.callback import ProvenanceRecord
from svfl_models.training.provenance.session import DataRecord, dataset, file
from svfl_models.training.run_settings import settings_of_run
from svfl_models.training.trackers.names import check_trackers
from svfl_models.training.trackers.trackers import NO_TRACKERS, Trackers, opened
from svfl_models.training.trainer import parameter_count, run, storage_errors

PROGRAM = "centering"
NO_WORKERS = "the samples of block centering are in memory, and the training draws their crops itself"
TEST_EVERY = 10
"""Number of epochs between two tests if no stopping rule needs the accuracy, because a test takes longer than an
epoch."""


def train_centering(
    config: TrainingConfig,
    out: Path,
    separate_test: Path | str | None = None,
    console: Console | None = None,
    *,
    hardware: Hardware = Hardware(),  # noqa: B008 - a value, frozen
    loggers: Sequence[str] = (),
) -> Result:
    """Train and test one network; the same configuration gives the same result on the same machine, interrupted or not.

    Adam, cross-entropy and the batches are those of the paper (Kohler et al., CoRL 2023, appendix). Unlike in the
    paper, images are augmented, and a training lasts `config.epochs` epochs whatever the test accuracy
    (docs/decisions.md).

    Args:
        config: Configuration of the network, the data and the training.
        out: Folder for the checkpoint, metrics, predictions, figures and report. If it holds an interrupted training of
            the same configuration, that training is resumed after its last complete epoch.
        separate_test: Dataset folder whose samples are all tested as well; no choice is made by their result. None for
            no such dataset.
        console: Console that progress is shown on; standard error by default.
        hardware: Devices, number format and threads. Several processes give the result of one, apart from rounding.
        loggers: Names of experiment trackers to log to, beside the metrics file (`training.trackers`).

    Returns:
        The outcome, which is also written to ``result.json``.

    Raises:
        UsageError: If the hardware or a tracker is not there.
        SvflError: If the data, the configuration or the folder cannot be used, or if the training diverges. If it
            diverges, ``checkpoint.ckpt`` holds the last epoch with a finite loss.
        KeyboardInterrupt: If the user stopped the training; ``checkpoint.ckpt`` holds the last complete epoch.

    Example:
        >>> from pathlib import Path
        >>> config = TrainingConfig("data/centering", encoder="vf", train_samples=25)
        >>> result = train_centering(config, Path("out/centering"))  # doctest: +SKIP
        >>> result.test_accuracy  # doctest: +SKIP
    """
    console = console or progress_console()
    check_trackers(loggers)
    placement = placed(hardware, needs_of(config.preset, config.group, NO_WORKERS))
    placement.prepare(console)
    config = with_camera(config)
    module, data, train, test = _unencoded(config)
    others = {"test": test} | ({} if separate_test is None else {"separate_test": samples_of(separate_test, config)})

    with run_folder.held(out):
        beside = {"separate_test": separate_test and str(separate_test)} | settings_of_run(hardware, loggers)
        resumed = run_folder.claim_or_resume(out, PROGRAM, config.plain(), beside, _check)
        metrics = KeptMetrics(out / run_folder.METRICS, COLUMNS)
        start = time.monotonic()
        if module.frozen:
            data.encode(module.classifier.trunk)
        encoding = time.monotonic() - start
        with storage_errors(out), opened(loggers, out, go_on=resumed is not None) as trackers:
            trackers.configuration(config.plain())
            provenance = ProvenanceRecord(out, data_records(config, separate_test), [config.seed])
            watching = [metrics, ProgressLine(config.epochs, console), provenance]
            fit(module, data, config, out, watching, resumed, placement=placement, trackers=trackers)

            evaluated = {name: evaluate(module, some, config) for name, some in others.items()}
            result = Result(
                test_accuracy=evaluated["test"].accuracy,
                best_test_accuracy=max(row["test_accuracy"] for row in metrics.rows if "test_accuracy" in row),
                separate_test_accuracy=evaluated["separate_test"].accuracy if "separate_test" in evaluated else None,
                offset_error_mm=evaluated["test"].offset_error_mm,
                epochs=len(metrics.rows),
                seconds=round(encoding + metrics.rows[-1]["seconds"], 1),
                parameters=parameter_count(module),
                train_samples=np.bincount(train.direction, minlength=4).tolist(),
                confusion=evaluated["test"].confusion.tolist(),
            )
            write_predictions(evaluated, out / run_folder.PREDICTIONS)
            write_report(out, config, result, metrics.rows, provenance.sessions, placement.plain())
            trackers.picture("confusion_matrix", out / run_folder.CONFUSION)
    return result


def _check(checkpoint: Path) -> None:
    """Refuse a damaged checkpoint, without a change of the random numbers that a frozen trunk's crops depend on."""
    with torch.random.fork_rng(devices=[]):
        load_classifier(checkpoint)


def data_records(config: TrainingConfig, separate_test: Path | str | None = None) -> dict[str, DataRecord]:
    """Return the identities of the datasets and files that a training reads, by the option that names them.

    Args:
        config: Configuration of the run.
        separate_test: Dataset folder whose samples are tested as well; None for none.
    """
    found = {"data": dataset(config.data)}
    if separate_test is not None:
        found["separate-test"] = dataset(separate_test)
    return found | ({} if config.latent is None else {"latent": file(config.latent.checkpoint)})


def _unencoded(config: TrainingConfig) -> tuple[CenteringModule, CenteringData, CenteringSamples, CenteringSamples]:
    """Return the network, its batches, and the training and test samples; a frozen trunk has not encoded them yet."""
    samples = samples_of(config.data, config)
    drawn, test_index = train_test_split(
        samples.direction, train=config.train_samples + config.valid_samples, test=config.test_samples, seed=config.seed
    )
    train, test = samples.take(drawn[: config.train_samples]), samples.take(test_index)
    valid = samples.take(drawn[config.train_samples :]) if config.valid_samples else None
    data = CenteringData(train, test, config, valid)
    pl.seed_everything(config.seed, verbose=False)
    module = module_of(config)
    module.classifier.fit(train)
    return module, data, train, test


def built(config: TrainingConfig) -> tuple[CenteringModule, CenteringData]:
    """Build the network and its batches as the training does; the same configuration gives the same in every process.

    Args:
        config: Configuration of the network, the data and the training, with a camera if it uses images.

    Raises:
        SvflError: If the data or the configuration cannot be used.
    """
    module, data, _, _ = _unencoded(config)
    if module.frozen:
        data.encode(module.classifier.trunk)
    return module, data


def with_camera(config: TrainingConfig) -> TrainingConfig:
    """Return a configuration that names the camera whose images are used, if any are.

    Args:
        config: Configuration of the run, whose camera may be None if its dataset has one camera.

    Raises:
        DatasetError: If the dataset has no episodes, or several cameras of which none is named.
        FormatError: If the dataset cannot be read.
    """
    if config.camera is not None or "v" not in config.encoder:
        return config
    return replace(config, camera=camera_of_dataset(Dataset.open(config.data), None))


def samples_of(path: Path | str, config: TrainingConfig) -> CenteringSamples:
    """Load the samples of a dataset with the window, view, camera, inputs and noise of a configuration.

    Args:
        path: Dataset folder.
        config: Configuration of the run.

    Raises:
        SvflError: If the dataset cannot be read or its samples cannot be used for training.
    """
    loaded = _load(str(path), config.window, config.view, INPUTS[config.encoder], config.camera)
    samples = with_noise(loaded, config.noise)
    check_samples(samples, config)
    return samples


@lru_cache(maxsize=4)  # a table of many runs reads its datasets once
def _load(path: str, window: int, view: View, inputs: tuple[str, ...], camera: str | None) -> CenteringSamples:
    return load_centering(path, window, view, inputs, camera)


class Stopping(EarlyStopping):
    """Stopping rule that also holds for a training which was interrupted after the rule had stopped it."""

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Stop a resumed training that has run out of patience before."""
        trainer.should_stop = trainer.should_stop or self.wait_count >= self.patience


def fit(
    module: CenteringModule,
    data: CenteringData,
    config: TrainingConfig,
    out: Path,
    callbacks: list[pl.Callback],
    resumed: Path | None = None,
    placement: Placement | None = None,
    trackers: Trackers = NO_TRACKERS,
) -> None:
    """Train a module, with a stopping rule if `config.patience` is not 0: that of the paper without validation samples.

    Args:
        module: The network to train.
        data: Training and test batches.
        config: Configuration that gives the number of epochs and the patience.
        out: Folder for the checkpoint.
        callbacks: Lightning callbacks of the training.
        resumed: Checkpoint of an interrupted training to continue. None starts a new training.
        placement: Devices, number format and threads; None for the default ones.
        trackers: Experiment trackers that the training is logged to.

    Raises:
        KeyboardInterrupt: If the user stopped the training.
    """
    monitored = "valid_accuracy" if config.valid_samples else "test_accuracy"
    stop = [Stopping(monitor=monitored, mode="max", patience=config.patience)] if config.patience else []
    every = 1 if config.patience or config.epochs < TEST_EVERY else TEST_EVERY
    run(
        module, data, out, callbacks, resumed, deciding=stop, placement=placement, trackers=trackers,
        rebuild=partial(built, config), max_epochs=config.epochs, check_val_every_n_epoch=every,
    )  # fmt: skip
