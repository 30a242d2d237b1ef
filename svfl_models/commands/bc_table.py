"""The command ``svfl-train bc-table``, which clones SVFL and CNN policies on several tasks and compares them."""

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from svfl_data.system.command_line import Commands, positive
from svfl_data.system.printable import say
from svfl_models.cloning.config import NETWORKS, CloningConfig
from svfl_models.configuration.program import Program, command_line
from svfl_models.configuration.setting import option, settings_of

EXAMPLE = (
    "svfl-train bc-table --data data/perturbed/block_picking data/perturbed/block_pushing --workers 2\n"
    "svfl-train bc-table --data data/block_picking --episodes 10 25 50 --seeds 1 --test-episodes 50 --out out/curve"
)
RECIPE = (
    "encoder", "camera", "view", "preset", "widths", "image_size", "window", "crop", "augment", "noise", "loss",
    "valid", "epochs", "batch_size", "learning_rate", "schedule",
)  # fmt: skip
"""Settings that all policies share."""


@dataclass(frozen=True)
class Table:
    """What the policies of a table differ in."""

    data: Annotated[list[str], option("dataset folders with demonstrations, one for each task", metavar="FOLDER")]
    episodes: Annotated[list[Annotated[int, option("", ge=1)]], option(
        "numbers of demonstrations to train on, one policy for each; --epochs is for the largest one, and with fewer "
        "demonstrations more epochs are trained, so that all policies have as many optimiser steps",
    )] = field(default_factory=lambda: [CloningConfig.episodes])  # fmt: skip
    seeds: Annotated[int, option("number of seeds; the seeds are 0 to N-1", ge=1)] = 3
    test_episodes: Annotated[int, option(
        "number of test episodes for each policy, the same ones for all", ge=1)] = 100  # fmt: skip
    networks: Annotated[list[str], option(
        "networks to compare: svfl, cnn, and cnn-rotated, which is a CNN whose training samples are rotated and "
        "mirrored at random",
        choices=tuple(NETWORKS), metavar="NETWORK")] = field(default_factory=lambda: list(NETWORKS))  # fmt: skip


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = PROGRAM.add(commands)
    add = parser.add_argument
    add("--workers", type=positive, default=1, metavar="N",
        help="number of policies that are trained or evaluated at the same time (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, default=Path("out/bc_table"), metavar="FOLDER",
        help="folder to write runs and results to (default: %(default)s)")  # fmt: skip
    add("--copy-report-to", type=Path, metavar="FOLDER",
        help="second folder to write the page, its figures and the results of all runs to (default: none)")  # fmt: skip


def run(values: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Train and evaluate the unfinished policies of the table, and print its page.

    Args:
        values: Value of each setting.
        arguments: Other options of the command.

    Raises:
        TrainingError: If the folder holds something else, or, at the end, if policies failed.
        SvflError: If a dataset cannot be opened, or a file cannot be written.
        KeyboardInterrupt: If the user stopped the command; finished policies are kept, and are on the page.
    """
    from rich.console import Console

    from svfl_data.datasets.dataset import Dataset
    from svfl_models.experiments import (
        cloning_table,  # torch, lightning and escnn take seconds to import
        cloning_table_page,  # torch, lightning and escnn take seconds to import
    )
    from svfl_models.experiments.runs import provenance
    from svfl_models.experiments.runs.folder import held
    from svfl_models.experiments.runs.grid import Grid
    from svfl_models.training import run_folder
    from svfl_models.training.trainer import storage_errors
    from svfl_models.training.writing import copy_file

    out, base = arguments.out, CloningConfig("", **{name: values[name] for name in RECIPE})
    episodes = sorted(set(values["episodes"]))
    networks = [network for network in NETWORKS if network in values["networks"]]
    runs = cloning_table.runs(base, values["data"], episodes, values["seeds"], values["test_episodes"], out, networks)
    jobs = {run.folder.name: run for run in runs}
    grid = Grid(out, jobs)
    for folder in {jobs[name].config.data for name in grid.unfinished()}:
        Dataset.open(folder)  # a misspelt folder is reported before anything begins
    command = command_line("bc-table", values, PROGRAM.settings)
    with held(out):
        run_folder.write_config(out, "bc-table", values)
        started = provenance.table_started(out, runs)
        try:
            grid.run(arguments.workers, Console(stderr=True))
        finally:
            with storage_errors(out):
                made = provenance.runs_section(started, (run.folder for run in runs if run.outcome()))
                words, files = cloning_table_page.write(cloning_table.Table(runs), command, out, made)
        if arguments.copy_report_to:
            with storage_errors(arguments.copy_report_to):
                arguments.copy_report_to.mkdir(parents=True, exist_ok=True)
                for file in files:
                    copy_file(
                        file, arguments.copy_report_to / (file.name if file.name != "runs.csv" else "bc_table.csv")
                    )
    say(*words.split("\n"), *files)
    grid.raise_failures()


PROGRAM = Program(
    "bc-table",
    help="compare SVFL and CNN policies that are trained by behaviour cloning on several tasks",
    description="Train SVFL and CNN policies by behaviour cloning on several datasets, evaluate each in simulation and "
    "write a page with their success rates, intervals over the seeds and learning curves. Finished policies are kept. "
    "After an interruption, the same command continues, each training after its last complete epoch. If a policy "
    "fails, the others are still trained, and the failure is reported at the end.",
    example=EXAMPLE,
    settings=(*settings_of(Table), *(setting for setting in settings_of(CloningConfig) if setting.name in RECIPE)),
    run=run,
)
