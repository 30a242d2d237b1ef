"""The command ``svfl-train bc-table``, which clones SVFL and CNN policies on several tasks and compares them."""

import argparse
import shlex
from pathlib import Path

from svfl_data.system.command_line import Commands, positive
from svfl_data.system.printable import say
from svfl_models.cloning.config import ENCODERS, NETWORKS, VIEWS, CloningConfig
from svfl_models.networks.presets import PRESETS

EXAMPLE = (
    "svfl-train bc-table --data data/perturbed/block_picking data/perturbed/block_pushing --workers 2\n"
    "svfl-train bc-table --data data/perturbed/block_picking --episodes 10 25 50 --seeds 1 --trials 50 --out out/curve"
)
DEFAULT = CloningConfig(data="")
RECIPE = ("encoder", "camera", "view", "preset", "epochs")
"""Options that become part of every policy's configuration."""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "bc-table", help="compare SVFL and CNN policies that are trained by behaviour cloning on several tasks",
        example=EXAMPLE,
        description="Train SVFL and CNN policies by behaviour cloning on several datasets, evaluate each in simulation "
        "and write a page with their success rates, intervals over the seeds and learning curves. Finished policies "
        "are kept. After an interruption, the same command continues, each training after its last complete epoch. If "
        "a policy fails, the others are still trained, and the failure is reported at the end.",
    )  # fmt: skip
    add = parser.add_argument
    add("--data", type=Path, nargs="+", required=True, metavar="FOLDER", help="dataset folders with demonstrations")
    add("--episodes", type=positive, nargs="+", default=[DEFAULT.episodes], metavar="N",
        help=f"numbers of demonstrations to train on, one policy for each (default: {DEFAULT.episodes})")  # fmt: skip
    add("--seeds", type=positive, default=3, metavar="N",
        help="number of seeds; the seeds are 0 to N-1 (default: %(default)s)")  # fmt: skip
    add("--trials", type=positive, default=100, metavar="N",
        help="number of episodes in which each policy is evaluated (default: %(default)s)")  # fmt: skip
    add("--networks", nargs="+", choices=tuple(NETWORKS), default=list(NETWORKS), metavar="NETWORK",
        help="networks to compare: svfl, cnn, and cnn-rotated, which is a CNN whose training samples are rotated and "
        "mirrored at random (default: all)")  # fmt: skip
    add("--encoder", choices=ENCODERS, default=DEFAULT.encoder,
        help="inputs of the networks: v for image, f for wrench (force and torque), p for proprioception, or several "
        "of them (default: %(default)s)")  # fmt: skip
    add("--view", choices=VIEWS, default=DEFAULT.view,
        help="centre of the networks' images: the gripper, or the middle of the camera image "
        "(default: %(default)s)")  # fmt: skip
    add("--camera", metavar="NAME",
        help="camera whose images are used; must be given if there are several (default: the only camera)")  # fmt: skip
    add("--preset", choices=tuple(PRESETS), default=DEFAULT.preset,
        help="sizes of the networks' layers (default: %(default)s)")  # fmt: skip
    add("--epochs", type=positive, default=DEFAULT.epochs, metavar="N",
        help="number of epochs for the largest number of demonstrations; with fewer demonstrations more epochs are "
        "trained, so that all policies have as many optimiser steps (default: %(default)s)")  # fmt: skip
    add("--workers", type=positive, default=1, metavar="N",
        help="number of policies that are trained or evaluated at the same time (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, default=Path("out/bc_table"), metavar="FOLDER",
        help="folder to write runs and results to (default: %(default)s)")  # fmt: skip
    add("--copy-report-to", type=Path, metavar="FOLDER",
        help="second folder to write the page, its figures and the results of all runs to (default: none)")  # fmt: skip
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Train and evaluate the unfinished policies of the table, and print its page.

    Args:
        arguments: Options of the command.

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
    from svfl_models.experiments.runs.folder import held
    from svfl_models.experiments.runs.grid import Grid
    from svfl_models.training.trainer import storage_errors
    from svfl_models.training.writing import copy_file

    out, base = arguments.out, CloningConfig("", **{option: getattr(arguments, option) for option in RECIPE})
    episodes, data = sorted(set(arguments.episodes)), list(map(str, arguments.data))
    networks = [network for network in NETWORKS if network in arguments.networks]
    runs = cloning_table.runs(base, data, episodes, arguments.seeds, arguments.trials, out, networks)
    jobs = {run.folder.name: run for run in runs}
    grid = Grid(out, jobs)
    for folder in {jobs[name].config.data for name in grid.unfinished()}:
        Dataset.open(folder)  # a misspelt folder is reported before anything begins
    with held(out):
        try:
            grid.run(arguments.workers, Console(stderr=True))
        finally:
            with storage_errors(out):
                words, files = cloning_table_page.write(cloning_table.Table(runs), _command_line(arguments), out)
        if arguments.copy_report_to:
            with storage_errors(arguments.copy_report_to):
                arguments.copy_report_to.mkdir(parents=True, exist_ok=True)
                for file in files:
                    copy_file(
                        file, arguments.copy_report_to / (file.name if file.name != "runs.csv" else "bc_table.csv")
                    )
    say(*words.split("\n"), *files)
    grid.raise_failures()


def _command_line(arguments: argparse.Namespace) -> str:
    """Return the command line that gives the same numbers."""
    words = ["svfl-train", "bc-table", "--data", *map(str, arguments.data)]
    if arguments.episodes != [DEFAULT.episodes]:
        words += ["--episodes", *map(str, arguments.episodes)]
    words += ["--seeds", str(arguments.seeds), "--trials", str(arguments.trials)]
    if set(arguments.networks) != set(NETWORKS):
        words += ["--networks", *arguments.networks]
    for option in RECIPE:
        if getattr(arguments, option) != getattr(DEFAULT, option):
            words += [f"--{option}", str(getattr(arguments, option))]
    return shlex.join(words)
