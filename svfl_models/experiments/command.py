"""Running of an experiment from its options to its page: claim the folder, train missing runs, write the results."""

import argparse
import importlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, cast

from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.sampling.centering_samples import sample_of
from svfl_data.system.printable import say
from svfl_models.centering.config import Latent, TrainingConfig
from svfl_models.centering.pretrained import describe as describe_latent
from svfl_models.centering.train import with_camera
from svfl_models.configuration.setting import settings_of
from svfl_models.experiments import page
from svfl_models.experiments.results import Results
from svfl_models.experiments.runs.folder import RUNS, claimed, describe
from svfl_models.experiments.runs.grid import Grid
from svfl_models.experiments.runs.provenance import experiment_started, runs_section
from svfl_models.experiments.runs.run_cache import take_from
from svfl_models.experiments.runs.training import Training, run_name
from svfl_models.training import run_folder
from svfl_models.training.trainer import storage_errors
from svfl_models.training.writing import copy_file, write_text

SUMMARY = "summary.csv"


class Experiment(Protocol):
    """Protocol of the modules that define an experiment.

    Attributes:
        TITLE: Title of the experiment's page.
    """

    TITLE: str

    def cells(self, base: TrainingConfig, train_samples: Sequence[int], **given: object) -> list[TrainingConfig]:
        """Return the configurations of the experiment, all with seed 0.

        Args:
            base: Recipe that the configurations deviate from.
            train_samples: Sizes of the training set.
            given: Arguments that only this experiment takes.
        """

    def body(self, results: Results) -> str:
        """Return the page between title and recipe, in Markdown."""

    def draw(self, results: Results, folder: Path) -> list[Path]:
        """Write the figures that the page shows to a folder, and return their files."""


def run(name: str, values: Mapping[str, Any], command: str, arguments: argparse.Namespace) -> None:
    """Do the unfinished runs of an experiment, write its results and print its page.

    Args:
        name: Name of the experiment, a key of `commands.experiments.COMMANDS`.
        values: Value of each setting, see `commands.experiments.program_of`.
        command: Command line that gives the same numbers.
        arguments: Other options of the command.

    Raises:
        TrainingError: If the folder does not belong to this experiment, or, at the end, if runs failed.
        SvflError: If the data cannot be used, or a file cannot be written.
        KeyboardInterrupt: If the user stopped the experiment; finished runs are kept.
    """
    experiment = cast(Experiment, importlib.import_module(f"svfl_models.experiments.{name}"))
    out = arguments.out or Path("out") / f"centering_{name}"
    samples, seeds, separate = sorted(set(values["train_samples"])), values["seeds"], values["separate_test"]
    given = _given(values)  # a bad model is named before bad data
    recipe = {setting.name: values[setting.name] for setting in settings_of(TrainingConfig) if setting.name in values}
    base = with_camera(TrainingConfig(**recipe | {"train_samples": TrainingConfig.train_samples}))
    runs = {
        run_name(config, base): config
        for cell in experiment.cells(base, samples, **given)
        for config in (replace(cell, seed=seed) for seed in range(seeds))
    }
    about = describe(f"centering-{name}", base, separate)
    _check_enough(about["data"]["episodes"], max(samples), base)
    for path in (base.data, separate):
        if path is not None:
            _check_labelled(Dataset.open(path), base.camera)
    with claimed(out, about):
        started = experiment_started(out, about, seeds)
        if arguments.reuse:
            with storage_errors(out):
                take_from(arguments.reuse, about, out, runs)
        run_folder.write_config(out, f"centering-{name}", dict(values))
        grid = Grid(out, {name: Training(config, out / RUNS / name, separate) for name, config in runs.items()})
        try:
            grid.run(arguments.workers or usable_cores(), Console(stderr=True))
        finally:
            results = Results(runs, out / RUNS)
            with storage_errors(out):
                results.write_runs(out / "runs.csv")
                results.write_summary(out / SUMMARY)
        with storage_errors(out):
            words = f"# {experiment.TITLE}\n\n{experiment.body(results)}\n{page.seeds(results)}## How\n\n"
            words += page.how(command, results, about, seeds)
            words += f"\n{runs_section(started, (run.folder for run in results.runs if run.result))}"
            write_text(out / f"{name}.md", words)
            pictures = experiment.draw(results, out)
        if arguments.copy_report_to:
            with storage_errors(arguments.copy_report_to):
                publish(name, out, pictures, arguments.copy_report_to)
    say(*words.split("\n"))
    for file in (out / f"{name}.md", *pictures, out / SUMMARY, out / "runs.csv"):
        say(file)
    grid.raise_failures()


def publish(name: str, out: Path, pictures: Sequence[Path], docs: Path) -> None:
    """Copy page, figures and summary of an experiment to a folder.

    Args:
        name: Name of the experiment, which names the copied page and summary.
        out: Folder of the experiment.
        pictures: Files of the figures.
        docs: Folder to copy to, which is created if it does not exist.
    """
    docs.mkdir(parents=True, exist_ok=True)
    for file in (out / f"{name}.md", *pictures):
        copy_file(file, docs / file.name)
    copy_file(out / SUMMARY, docs / f"{name}.csv")


def usable_cores() -> int:
    """Return the number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _given(values: Mapping[str, Any]) -> dict[str, object]:
    """Return the arguments that only some experiments take: pretrained encoders and their uses, or nothing.

    Raises:
        FormatError: If a file is not the checkpoint of a latent model.
    """
    if "latents" not in values:
        return {}
    latents = [describe_latent(path, Latent.use) for path in values["latents"]]
    return {"latents": list({latent.sha256: latent for latent in latents}.values()), "uses": values["uses"]}


def _check_labelled(dataset: Dataset, camera: str | None) -> None:
    """Refuse a dataset that has no episodes, or whose first episode is no labelled sample, before a folder is claimed.

    Raises:
        SvflError: If the dataset has no episodes, or its first episode cannot be used as a sample.
    """
    if not dataset.indices:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    sample_of(dataset.read(dataset.indices[0]), camera=camera)


def _check_enough(episodes: int, train: int, base: TrainingConfig) -> None:
    """Refuse sizes of the training set for which the dataset has too few episodes.

    Raises:
        DatasetError: If `train` and the test samples together are more than the dataset's episodes.
    """
    if train + base.test_samples > episodes:
        raise DatasetError(
            f"{base.data} has {episodes} samples; {base.test_samples} for testing and {train} for training are "
            f"{base.test_samples + train}; collect more, or ask for fewer with --train-samples"
        )
