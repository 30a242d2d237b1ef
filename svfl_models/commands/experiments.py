"""The command ``svfl-train centering-table`` and similar ones, each of which makes a page of many trainings."""

import argparse
import functools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from svfl_data.system.command_line import Commands, positive
from svfl_models.centering.config import LatentSweep, SeparateTest, Sweep, TrainingConfig
from svfl_models.commands.options import add_out
from svfl_models.configuration.program import Program, command_line
from svfl_models.configuration.setting import settings_of

RECIPE = (
    "camera", "test_samples", "preset", "widths", "window", "crop", "epochs", "patience", "batch_size",
    "learning_rate", "schedule", "augment",
)  # fmt: skip
"""Settings that all runs of an experiment share."""


@dataclass(frozen=True)
class Experiment:
    """An experiment that has a command.

    Attributes:
        help: One line of help that says what the experiment compares.
        train_samples: Sizes of the training set, unless the user gives others.
        example: Example command lines for the help.
    """

    help: str
    train_samples: tuple[int, ...]
    example: str


_DATA = "--data data/centering --separate-test data/centering_test"
COMMANDS = {
    "table": Experiment(
        "make the table of the paper: V, F and V+F with SVFL and CNN, by number of training samples", (10, 25, 50, 100),
        f"svfl-train centering-table {_DATA} --workers 2\n"
        f"svfl-train centering-table {_DATA} --seeds 1 --train-samples 10 --epochs 20 --out out/first_look",
    ),
    "acuity": Experiment(
        "compare images of 64, 32, 16 and 8 pixels, with and without force", (100,),
        f"svfl-train centering-acuity {_DATA} --workers 2",
    ),
    "groups": Experiment(
        "compare accuracy and time of the symmetry groups none, C4, D4, C8, D8 and D12", (25, 100),
        f"svfl-train centering-groups {_DATA} --workers 2",
    ),
    "ablation": Experiment(
        "compare axial and polar torque, augmentations, the view from above, and sensor noise", (10, 100),
        f"svfl-train centering-ablation {_DATA} --workers 2",
    ),
    "latents": Experiment(
        "compare SVFL and CNN with pretrained VTT, PoE and concat: frozen, fine-tuned, from scratch", (10, 25, 50, 100),
        f"svfl-train centering-latents {_DATA} --latents out/latent_poe/checkpoint.ckpt out/latent_vtt/checkpoint.ckpt"
        " --reuse out/centering_table",
    ),
}  # fmt: skip


def program_of(name: str) -> Program:
    """Return the command of an experiment.

    Args:
        name: Name of the experiment, a key of `COMMANDS`.
    """
    one = COMMANDS[name]
    own = {setting.name: setting for setting in settings_of(Sweep)}
    samples = replace(own["train_samples"], default=list(one.train_samples))
    recipe = [setting for setting in settings_of(TrainingConfig) if setting.name in RECIPE]
    settings = [own["data"], *settings_of(SeparateTest), *(settings_of(LatentSweep) if name == "latents" else ())]
    return Program(
        f"centering-{name}",
        help=one.help,
        description=f"Train and test many block-centering networks to {one.help}.\n"
        "Finished runs are kept. After an interruption, the same command continues, each training after its last "
        "complete epoch.",
        example=one.example,
        settings=(*settings, samples, own["seeds"], *recipe),
        run=functools.partial(run, name),
    )


def add(commands: Commands) -> None:
    """Add a command for each experiment to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which these are added.
    """
    for name in COMMANDS:
        parser = program_of(name).add(commands)
        add = parser.add_argument
        add("--workers", type=positive, metavar="N",
            help="number of trainings that run at the same time (default: one per core)")  # fmt: skip
        add_out(parser, f"out/centering_{name}")
        add("--reuse", type=Path, metavar="FOLDER",
            help="folder of another experiment whose finished runs with equal settings and data are used instead of "
            "new trainings (default: none)")  # fmt: skip
        add("--copy-report-to", type=Path, metavar="FOLDER",
            help="second folder to write the page, its figures and the summary to (default: none)")  # fmt: skip


def run(name: str, values: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Do the unfinished runs of an experiment, and print its page.

    Args:
        name: Name of the experiment.
        values: Value of each setting.
        arguments: Other options of the command.

    Raises:
        SvflError: If the data or the folder cannot be used, a file cannot be written or, at the end, if runs failed.
        KeyboardInterrupt: If the user stopped the experiment; finished runs are kept.
    """
    from svfl_models.experiments import command  # torch, lightning and escnn take seconds to import

    command.run(name, values, command_line(f"centering-{name}", values, program_of(name).settings), arguments)
