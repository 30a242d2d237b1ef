"""The command ``svfl-train centering``, which trains one block-centering network."""

import argparse
from pathlib import Path
from typing import Any

from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands
from svfl_data.system.printable import say
from svfl_models.centering.config import USES, Latent, SeparateTest, TrainingConfig
from svfl_models.commands.options import add_model, add_out, positive_number, with_model
from svfl_models.configuration.program import Program
from svfl_models.configuration.resolving import build
from svfl_models.configuration.setting import settings_of
from svfl_models.training.run_settings import RunSettings

EXAMPLE = """\
svfl-train centering --data data/centering --encoder vf --model svfl --train-samples 100 --seed 0 --out out/centering
svfl-train centering --data data/centering --encoder f --model cnn --train-samples 10
svfl-train centering --data data/centering --encoder vf --group D8 --target offset
svfl-train centering --data data/centering --set widths.latent=12 --set epochs=100 --print-config
svfl-train centering --data data/centering --latent out/latent_poe/checkpoint.ckpt --use frozen"""
OF_OWN_ENCODERS = ("encoder", "group", "preset", "widths", "torque", "window", "image_size", "crop")
"""Settings that have no effect on a network with a latent encoder."""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = PROGRAM.add(commands)
    add = parser.add_argument
    add_model(parser)
    add("--latent", type=Path, metavar="CHECKPOINT",
        help="checkpoint of svfl-train latent whose pretrained encoder replaces the network's own; then leave out "
        "--encoder, --model, --group, --preset, --torque, --window, --image-size and --crop "
        "(default: none)")  # fmt: skip
    add("--use", choices=USES,
        help="with --latent: frozen trains only the head, and leaves the colours of the images unchanged; fine-tuned "
        "trains the encoder as well; from-scratch trains both from random weights, for comparison "
        f"(default: {Latent.use})")  # fmt: skip
    add("--latent-rate", type=positive_number, default=Latent.learning_rate, metavar="R",
        help="with --latent: learning rate of the encoder at the start of the training, above 0 "
        "(default: %(default)s)")  # fmt: skip
    add_out(parser, "out/centering_ENCODER_GROUP_N_seedS")


def with_latent(given: dict[str, Any], arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given settings with those that --model and --latent stand for.

    Args:
        given: Settings that the user gives.
        arguments: Other options of the command.

    Raises:
        UsageError: If options contradict each other.
        FormatError: If the file given by --latent is not the checkpoint of a latent model.
    """
    if arguments.latent is None:
        if arguments.use:
            raise UsageError("--use is for a pretrained encoder; name its checkpoint with --latent")
        return with_model(given, arguments)
    unused = [name for name in OF_OWN_ENCODERS if name in given] + (["model"] if arguments.model else [])
    if unused:
        raise UsageError(f"--latent brings its own encoder; leave out --{unused[0].replace('_', '-')}")

    from svfl_models.centering import pretrained  # torch takes seconds to import

    latent = pretrained.describe(arguments.latent, arguments.use or Latent.use, arguments.latent_rate)
    return given | pretrained.settings(latent, given.get("augment", TrainingConfig.augment))


def run(values: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Train one network, and print its result and the paper's.

    Args:
        values: Value of each setting.
        arguments: Other options of the command.

    Raises:
        SvflError: If the network cannot be trained on the dataset, or a file cannot be written.
    """
    config, out, separate_test = build(TrainingConfig, values), arguments.out, values["separate_test"]
    if out is None:
        network = config.latent or f"{config.encoder}_{config.group}"
        out = Path("out") / f"centering_{network}_{config.train_samples}_seed{config.seed}"

    from svfl_models.centering import (
        paper_figures,  # torch, lightning and escnn take seconds to import
        report,  # torch, lightning and escnn take seconds to import
        train,  # torch, lightning and escnn take seconds to import
    )
    from svfl_models.training import run_folder  # torch, lightning and escnn take seconds to import

    given = build(RunSettings, values)
    result = train.train_centering(config, out, separate_test, hardware=given.hardware, loggers=given.logger)
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


PROGRAM = Program(
    "centering",
    help="train a block-centering network, which predicts how the gripper must move",
    description="Train and test one block-centering network. From images and forces after a collision with a block it "
    "predicts in which direction, or how far, the gripper must move to be centred on the block. The same command gives "
    "the same result. After an interruption, the same command continues after the last complete epoch.",
    example=EXAMPLE,
    settings=(*settings_of(TrainingConfig), *settings_of(SeparateTest), *settings_of(RunSettings)),
    run=run,
    prepare=with_latent,
)
