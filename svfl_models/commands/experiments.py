"""The command ``svfl-train centering-table`` and similar ones, each of which makes a page of many trainings."""

import argparse
import functools
from dataclasses import dataclass
from pathlib import Path

from svfl_data.system.command_line import Commands, positive
from svfl_models.centering.config import USES
from svfl_models.commands.options import add_data, add_recipe


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


def add(commands: Commands) -> None:
    """Add a command for each experiment to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which these are added.
    """
    for name, one in COMMANDS.items():
        parser = commands.add_parser(
            f"centering-{name}", help=one.help, example=one.example,
            description=f"Train and test many block-centering networks to {one.help}.\n"
            "Finished runs are kept. After an interruption, the same command continues.",
        )  # fmt: skip
        add_data(parser)
        add = parser.add_argument
        if name == "latents":
            add("--latents", type=Path, nargs="+", required=True, metavar="CHECKPOINT",
                help="checkpoints of svfl-train latent to compare")  # fmt: skip
            add("--uses", choices=USES, nargs="+", default=list(USES), metavar="USE",
                help="how to use the pretrained encoders: frozen trains only the head; fine-tuned trains the encoder "
                "as well; from-scratch trains both from random weights, for comparison (default: all)")  # fmt: skip
        add("--seeds", type=positive, default=3, metavar="N",
            help="number of seeds; the seeds are 0 to N-1 (default: %(default)s)")  # fmt: skip
        add("--train-samples", type=positive, nargs="+", metavar="N",
            help="numbers of training samples to compare "
            f"(default: {' '.join(map(str, one.train_samples))})")  # fmt: skip
        add("--workers", type=positive, metavar="N",
            help="number of trainings that run at the same time (default: one per core)")  # fmt: skip
        add_recipe(parser)
        add("--out", type=Path, metavar="FOLDER",
            help=f"folder to write runs and results to (default: out/centering_{name})")  # fmt: skip
        add("--reuse", type=Path, metavar="FOLDER",
            help="folder of another experiment whose finished runs with equal settings and data are used instead of "
            "new trainings (default: none)")  # fmt: skip
        add("--copy-report-to", type=Path, metavar="FOLDER",
            help="second folder to write the page, its figures and the summary to (default: none)")  # fmt: skip
        parser.set_defaults(command=functools.partial(run, one), experiment=name)


def run(experiment: Experiment, arguments: argparse.Namespace) -> None:
    """Do the unfinished runs of an experiment, and print its page.

    Args:
        experiment: Experiment of the command.
        arguments: Options of the command.

    Raises:
        SvflError: If the data or the folder cannot be used, a file cannot be written or, at the end, if runs failed.
        KeyboardInterrupt: If the user stopped the experiment; finished runs are kept.
    """
    from svfl_models.experiments import command  # torch, lightning and escnn take seconds to import

    command.run(arguments, experiment.train_samples)
