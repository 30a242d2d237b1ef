"""The command ``svfl-train centering``, which trains one block-centering network."""

import argparse
from pathlib import Path
from typing import Any

from svfl_data.errors import UsageError
from svfl_data.sampling.centering_samples import VIEWS
from svfl_data.system.command_line import Commands, natural, positive
from svfl_data.system.printable import say
from svfl_models.centering.config import MODELS, TARGETS, USES, Latent, TrainingConfig
from svfl_models.commands.options import DEFAULT, add_data, add_recipe, group_of, positive_number
from svfl_models.networks.inputs import ENCODERS, IMAGE_SIZES
from svfl_models.symmetry.groups import GROUPS, TORQUES

EXAMPLE = """\
svfl-train centering --data data/centering --encoder vf --model svfl --train-samples 100 --seed 0 --out out/centering
svfl-train centering --data data/centering --encoder f --model cnn --train-samples 10
svfl-train centering --data data/centering --encoder vf --group D8 --target offset
svfl-train centering --data data/centering --latent out/latent_poe/checkpoint.ckpt --use frozen"""
OF_OWN_ENCODERS = {
    "encoder": None, "model": None, "group": None,
    "preset": DEFAULT.preset, "torque": DEFAULT.torque, "image_size": DEFAULT.image_size,
}  # fmt: skip
"""Options that have no effect on a network with a latent encoder, and their values if the user does not give them."""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "centering", help="train a block-centering network, which predicts how the gripper must move", example=EXAMPLE,
        description="Train and test one block-centering network. From images and forces after a collision with a block "
        "it predicts in which direction, or how far, the gripper must move to be centred on the block. The same "
        "command gives the same result.",
    )  # fmt: skip
    add_data(parser)
    add = parser.add_argument
    add("--encoder", choices=ENCODERS,
        help="inputs of the network: v for image, f for wrench (force and torque), vf for both "
        f"(default: {DEFAULT.encoder})")  # fmt: skip
    add("--model", choices=MODELS,
        help="kind of network: svfl is symmetric; cnn is the baseline without symmetry that has about as many "
        "parameters, the same as --group none (default: svfl)")  # fmt: skip
    add("--group", choices=tuple(GROUPS),
        help="symmetry group of the network: C for rotations, D for rotations and reflections, and the number of "
        f"rotations; none for no symmetry (default: {DEFAULT.group}, or none with --model cnn)")  # fmt: skip
    add("--train-samples", type=positive, default=DEFAULT.train_samples, metavar="N",
        help="number of training samples, balanced over the four directions (default: %(default)s)")  # fmt: skip
    add("--seed", type=natural, default=DEFAULT.seed, metavar="S",
        help="seed of the training and of the choice of training samples, at least 0 "
        "(default: %(default)s)")  # fmt: skip
    add("--target", choices=TARGETS, default=DEFAULT.target,
        help="quantity to predict: one of four directions, or the offset in m (default: %(default)s)")  # fmt: skip
    add("--torque", choices=TORQUES, default=DEFAULT.torque,
        help="how a torque transforms under reflections: axial (correct), or polar as in the paper "
        "(default: %(default)s)")  # fmt: skip
    add("--view", choices=VIEWS, default=DEFAULT.view,
        help="viewpoint of the images: camera as recorded, or top as seen from straight above "
        "(default: %(default)s)")  # fmt: skip
    add("--image-size", type=int, choices=IMAGE_SIZES, default=DEFAULT.image_size,
        help="height and width of the network's images, px (default: %(default)s)")  # fmt: skip
    add("--latent", type=Path, metavar="CHECKPOINT",
        help="checkpoint of svfl-train latent whose pretrained encoder replaces the network's own; then leave out "
        "--encoder, --model, --group, --preset, --torque and --image-size (default: none)")  # fmt: skip
    add("--use", choices=USES,
        help="with --latent: frozen trains only the head, and leaves the colours of the images unchanged; fine-tuned "
        "trains the encoder as well; from-scratch trains both from random weights, for comparison "
        f"(default: {Latent.use})")  # fmt: skip
    add("--latent-rate", type=positive_number, default=Latent.learning_rate, metavar="R",
        help="with --latent: learning rate of the encoder at the start of the training, above 0 "
        "(default: %(default)s)")  # fmt: skip
    add("--rotate", action="store_true",
        help="rotate training samples by random quarter turns and mirror them at random (default: not)")  # fmt: skip
    add_recipe(parser)
    add("--out", type=Path, metavar="FOLDER",
        help="folder to write the run to (default: out/centering_ENCODER_GROUP_N_seedS)")  # fmt: skip
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Train one network, and print its result and the paper's.

    Args:
        arguments: Options of the command.

    Raises:
        UsageError: If options contradict each other.
        SvflError: If the network cannot be trained on the dataset, or a file cannot be written.
    """
    options = vars(arguments) | {"data": str(arguments.data)} | _network(arguments)
    out, separate_test = options.pop("out"), options.pop("separate_test")
    for name in ("command", "model", "use", "latent_rate"):
        del options[name]
    config = TrainingConfig(**options)
    if out is None:
        network = config.latent or f"{config.encoder}_{config.group}"
        out = Path("out") / f"centering_{network}_{config.train_samples}_seed{config.seed}"

    from svfl_models.centering import (
        paper_figures,  # torch, lightning and escnn take seconds to import
        report,  # torch, lightning and escnn take seconds to import
        train,  # torch, lightning and escnn take seconds to import
    )
    from svfl_models.training import run_folder  # torch, lightning and escnn take seconds to import

    result = train.train_centering(config, out, separate_test)
    figure = paper_figures.centering_words(config.encoder, config.model, config.train_samples)
    say(f"{report.cell_name(config)}: test accuracy {result.test_accuracy:.1%} (paper: {figure})")
    if result.separate_test_accuracy is not None:
        say(f"on the samples of {separate_test}: {result.separate_test_accuracy:.1%}")
    if result.offset_error_mm is not None:
        say(f"predicted offsets are {result.offset_error_mm:.1f} mm off on average")
    say(f"{result.parameters:,} parameters, {result.epochs} epochs, {result.seconds:.0f} s of training")
    say(f"data        {config.data}")
    say(f"checkpoint  {out / run_folder.CHECKPOINT}")
    say(f"report      {out / run_folder.REPORT}")


def _network(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of a configuration that describe the network.

    Raises:
        UsageError: If options contradict each other.
        FormatError: If the file given by --latent is not the checkpoint of a latent model.
    """
    if arguments.latent is None:
        if arguments.use:
            raise UsageError("--use says what to do with a pretrained encoder; name its checkpoint with --latent")
        return {"encoder": arguments.encoder or DEFAULT.encoder, "group": group_of(arguments)}
    given = [name for name, usual in OF_OWN_ENCODERS.items() if getattr(arguments, name) != usual]
    if given:
        raise UsageError(f"--latent brings its own encoder; leave out --{given[0].replace('_', '-')}")

    from svfl_models.centering import pretrained  # torch takes seconds to import

    latent = pretrained.describe(arguments.latent, arguments.use or Latent.use, arguments.latent_rate)
    return pretrained.settings(latent, arguments.augment)
