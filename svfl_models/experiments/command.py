"""Running of an experiment from its options to its page: claim the folder, train missing runs, write the results."""

import argparse
import importlib
import os
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol, cast

from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.sampling.centering_samples import sample_of
from svfl_data.system.printable import say
from svfl_models.centering.config import USES, Latent, TrainingConfig
from svfl_models.centering.pretrained import describe as describe_latent
from svfl_models.centering.train import with_camera
from svfl_models.experiments import page
from svfl_models.experiments.results import Results
from svfl_models.experiments.runs.folder import RUNS, claimed, describe
from svfl_models.experiments.runs.grid import Grid
from svfl_models.experiments.runs.run_cache import take_from
from svfl_models.experiments.runs.training import Training, run_name
from svfl_models.training.trainer import storage_errors
from svfl_models.training.writing import copy_file, write_text

RECIPE = ("camera", "test_samples", "preset", "epochs", "patience", "learning_rate", "augment")
"""Options that become part of every run's configuration."""
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


def run(arguments: argparse.Namespace, usual_samples: Sequence[int]) -> None:
    """Do the unfinished runs of an experiment, write its results and print its page.

    Args:
        arguments: Options of the command, see `commands.experiments`.
        usual_samples: Sizes of the training set if the options name none.

    Raises:
        TrainingError: If the folder does not belong to this experiment, or, at the end, if runs failed.
        SvflError: If the data cannot be used, or a file cannot be written.
        KeyboardInterrupt: If the user stopped the experiment; finished runs are kept.
    """
    name = arguments.experiment
    experiment = cast(Experiment, importlib.import_module(f"svfl_models.experiments.{name}"))
    out = arguments.out or Path("out") / f"centering_{name}"
    samples = sorted(set(arguments.train_samples or usual_samples))
    given = _given(arguments)  # a bad model is named before bad data
    base = with_camera(TrainingConfig(str(arguments.data), **{option: getattr(arguments, option) for option in RECIPE}))
    runs = {
        run_name(config, base): config
        for cell in experiment.cells(base, samples, **given)
        for config in (replace(cell, seed=seed) for seed in range(arguments.seeds))
    }
    about = describe(f"centering-{name}", base, arguments.separate_test)
    _check_enough(about["data"]["episodes"], max(samples), base)
    for path in (base.data, arguments.separate_test):
        if path is not None:
            _check_labelled(Dataset.open(path), base.camera)
    with claimed(out, about):
        if arguments.reuse:
            with storage_errors(out):
                take_from(arguments.reuse, about, out, runs)
        separate = arguments.separate_test
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
            words += page.how(command_line(arguments, samples, usual_samples), results, about, arguments.seeds)
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


def command_line(arguments: argparse.Namespace, samples: Sequence[int], usual_samples: Sequence[int]) -> str:
    """Return the command line that gives the same numbers, with only those options on which they depend.

    Args:
        arguments: Options of the command.
        samples: Sizes of the training set.
        usual_samples: Sizes of the training set if the options name none.
    """
    words = ["svfl-train", f"centering-{arguments.experiment}", "--data", str(arguments.data)]
    usual = TrainingConfig("")
    words += ["--separate-test", str(arguments.separate_test)] if arguments.separate_test else []
    if "latents" in arguments:
        words += ["--latents", *map(str, arguments.latents)]
        words += [] if set(arguments.uses) == set(USES) else ["--uses", *arguments.uses]
    words += ["--seeds", str(arguments.seeds)]
    if list(samples) != list(usual_samples):
        words += ["--train-samples", *map(str, samples)]
    for option in RECIPE:
        if option == "augment":
            words += [] if arguments.augment else ["--plain-images"]
        elif getattr(arguments, option) != getattr(usual, option):
            words += [f"--{option.replace('_', '-')}", str(getattr(arguments, option))]
    return shlex.join(words)


def usable_cores() -> int:
    """Return the number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _given(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the arguments that only some experiments take: pretrained encoders and their uses, or nothing.

    Raises:
        FormatError: If a file is not the checkpoint of a latent model.
    """
    if "latents" not in arguments:
        return {}
    latents = [describe_latent(path, Latent.use) for path in arguments.latents]
    return {"latents": list({latent.sha256: latent for latent in latents}.values()), "uses": arguments.uses}


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
