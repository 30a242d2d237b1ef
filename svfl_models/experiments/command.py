"""An experiment from its options to its page: claim the folder, train what is missing, show what there is."""

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
from svfl_models.experiments import page
from svfl_models.experiments.results import Results
from svfl_models.experiments.runs.folder import RUNS, claimed, describe
from svfl_models.experiments.runs.grid import Grid
from svfl_models.experiments.runs.run_cache import take_from
from svfl_models.experiments.runs.training import Training, run_name
from svfl_models.training.trainer import storage_errors
from svfl_models.training.writing import copy_file, write_text

RECIPE = ("test_samples", "preset", "epochs", "patience", "learning_rate", "augment")
"""Options that become part of every run's configuration."""
SUMMARY = "summary.csv"


class Experiment(Protocol):
    """What the module of an experiment defines."""

    TITLE: str

    def cells(self, base: TrainingConfig, train_samples: Sequence[int], **given: object) -> list[TrainingConfig]:
        """The configurations, all with seed 0; `given` is what only this experiment asks for."""

    def body(self, results: Results) -> str:
        """The page between title and recipe, in Markdown."""

    def draw(self, results: Results, folder: Path) -> list[Path]:
        """Write the figures that the page shows."""


def run(arguments: argparse.Namespace, usual_samples: Sequence[int]) -> None:
    """Do an experiment, or what is left of it, and print its page.

    Args:
        arguments: Options of the command, see `commands.experiments`.
        usual_samples: Sizes of the training set if none are asked for.

    Raises:
        TrainingError: If the folder holds something else, or at the end if runs failed.
        SvflError: If the data cannot serve.
        KeyboardInterrupt: If the user stopped it; finished runs are kept.
    """
    name = arguments.experiment
    experiment = cast(Experiment, importlib.import_module(f"svfl_models.experiments.{name}"))
    out = arguments.out or Path("out") / f"centering_{name}"
    samples = sorted(set(arguments.train_samples or usual_samples))
    base = TrainingConfig(str(arguments.data), **{option: getattr(arguments, option) for option in RECIPE})
    runs = {
        run_name(config, base): config
        for cell in experiment.cells(base, samples, **_given(arguments))
        for config in (replace(cell, seed=seed) for seed in range(arguments.seeds))
    }
    about = describe(f"centering-{name}", base, arguments.separate_test)
    _check_enough(about["data"]["episodes"], max(samples), base)
    for path in (base.data, arguments.separate_test):
        if path is not None:
            _check_labelled(Dataset.open(path))
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
            words = f"# {experiment.TITLE}\n\n{experiment.body(results)}\n## How\n\n"
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
    """Copy page, figures and summary to where documentation keeps them, under names that stay."""
    docs.mkdir(parents=True, exist_ok=True)
    for file in (out / f"{name}.md", *pictures):
        copy_file(file, docs / file.name)
    copy_file(out / SUMMARY, docs / f"{name}.csv")


def command_line(arguments: argparse.Namespace, samples: Sequence[int], usual_samples: Sequence[int]) -> str:
    """The command that gives the same numbers: only the options on which they depend."""
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
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _given(arguments: argparse.Namespace) -> dict[str, object]:
    """What an experiment asks for besides the recipe: pretrained encoders, or nothing.

    Raises:
        FormatError: If a checkpoint is none of a latent pretraining.
    """
    if "latents" not in arguments:
        return {}
    latents = [describe_latent(path, Latent.use) for path in arguments.latents]
    return {"latents": list({latent.sha256: latent for latent in latents}.values()), "uses": arguments.uses}


def _check_labelled(dataset: Dataset) -> None:
    """Refuse what no run can learn from or be tested on, before a folder is claimed for it."""
    if not dataset.indices:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    sample_of(dataset.read(dataset.indices[0]))


def _check_enough(episodes: int, train: int, base: TrainingConfig) -> None:
    """Refuse what every run of a column would refuse."""
    if train + base.test_samples > episodes:
        raise DatasetError(
            f"{base.data} has {episodes} samples; {base.test_samples} for testing and {train} for training are "
            f"{base.test_samples + train}; collect more, or ask for fewer with --train-samples"
        )
