"""``svfl-train centering``: train one block-centering network."""

import argparse
from pathlib import Path

from svfl_data.centering import VIEWS
from svfl_data.cli import Commands, natural, positive
from svfl_data.errors import UsageError
from svfl_models.config import ENCODERS, IMAGE_SIZES, MODELS, TARGETS, TORQUES, TrainingConfig
from svfl_models.groups import GROUPS
from svfl_models.verbs.options import DEFAULT, add_data, add_recipe

EXAMPLE = """\
svfl-train centering --data data/centering --encoder vf --model svfl --train-samples 100 --seed 0 --out out/centering
svfl-train centering --data data/centering --encoder f --model cnn --train-samples 10
svfl-train centering --data data/centering --encoder vf --group D8 --target offset"""


def add(commands: Commands) -> None:
    """Put the verb on the command line."""
    verb = commands.add_parser(
        "centering", help="block centering: which way, or how far, must the hand move?", example=EXAMPLE,
        description="Train and test one block-centering network; the same command gives the same result.",
    )  # fmt: skip
    add_data(verb)
    add = verb.add_argument
    add("--encoder", choices=ENCODERS, default=DEFAULT.encoder, help="image, force, or both (default: %(default)s)")
    add("--model", choices=MODELS, help="svfl: symmetric (default); cnn: its plain twin, the same as --group none")
    add("--group", choices=tuple(GROUPS), help=f"symmetry of the network (default: {DEFAULT.group})")
    add("--train-samples", type=positive, default=DEFAULT.train_samples, metavar="N", help="default: %(default)s")
    add("--seed", type=natural, default=DEFAULT.seed, metavar="S", help="default: %(default)s")
    add("--target", choices=TARGETS, default=DEFAULT.target, help="what to predict (default: %(default)s)")
    add("--torque", choices=TORQUES, default=DEFAULT.torque, help="how a torque transforms (default: %(default)s)")
    add("--view", choices=VIEWS, default=DEFAULT.view, help="images as taken, or from above (default: %(default)s)")
    add("--image-size", type=int, choices=IMAGE_SIZES, default=DEFAULT.image_size, help="[px] (default: %(default)s)")
    add("--rotate", action="store_true", help="turn and mirror the training samples at random")
    add_recipe(verb)
    add("--out", type=Path, metavar="FOLDER", help="default: out/centering_ENCODER_GROUP_N_seedS")
    verb.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Train one network and print its result beside the paper's."""
    options = vars(arguments) | {"data": str(arguments.data), "group": _group(arguments)}
    out, fresh = options.pop("out"), options.pop("fresh")
    del options["command"], options["model"]
    config = TrainingConfig(**options)
    if out is None:
        out = Path("out") / f"centering_{config.encoder}_{config.group}_{config.train_samples}_seed{config.seed}"

    from svfl_models import paper, report, run_folder, train  # torch, lightning and escnn take seconds to import

    result = train.train_centering(config, out, fresh)
    figure = paper.centering_words(config.encoder, config.model, config.train_samples)
    print(f"{report.cell_name(config)}: test accuracy {result.test_accuracy:.1%} (paper: {figure})")
    if result.fresh_accuracy is not None:
        print(f"on the samples of {fresh}: {result.fresh_accuracy:.1%}")
    if result.offset_error_mm is not None:
        print(f"predicted offsets are {result.offset_error_mm:.1f} mm off on average")
    print(f"{result.parameters:,} parameters, {result.epochs} epochs, {result.seconds:.0f} s of training")
    print(f"data        {config.data}")
    print(f"checkpoint  {out / run_folder.CHECKPOINT}")
    print(f"report      {out / run_folder.REPORT}")


def _group(arguments: argparse.Namespace) -> str:
    """The group that --model and --group ask for together.

    Raises:
        UsageError: If they contradict each other.
    """
    model, group = arguments.model, arguments.group
    if model and group and (model == "cnn") != (group == "none"):
        raise UsageError(f"--model {model} and --group {group} contradict each other")
    return group or ("none" if model == "cnn" else DEFAULT.group)
