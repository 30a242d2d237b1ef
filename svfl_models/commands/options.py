"""Argument types and options of a training that several commands share."""

import argparse
import math
from pathlib import Path

from svfl_data.errors import UsageError
from svfl_data.system.command_line import Parser, natural, positive
from svfl_models.centering.config import TrainingConfig
from svfl_models.networks.presets import PRESETS

DEFAULT = TrainingConfig(data="")


def positive_number(text: str) -> float:
    """Return the finite number above zero that a text stands for; this is a type of arguments for argparse.

    Raises:
        argparse.ArgumentTypeError: If the text is not such a number.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def add_data(parser: Parser) -> None:
    """Add the options that name what is learned from, --data, --separate-test and --camera, to a parser."""
    parser.add_argument("--data", type=Path, required=True, help="dataset folder of svfl-collect centering")
    parser.add_argument(
        "--separate-test", type=Path,
        help="second dataset folder of svfl-collect centering, all of whose samples are tested too and none of which "
        "is trained on (default: none)",
    )  # fmt: skip
    parser.add_argument(
        "--camera", metavar="NAME",
        help="camera whose images are used; must be given if there are several (default: the only camera)",
    )  # fmt: skip


def add_recipe(parser: Parser) -> None:
    """Add the options that say how to train, such as sizes and the stopping rule, to a parser."""
    add = parser.add_argument
    add("--test-samples", type=positive, default=DEFAULT.test_samples, metavar="N",
        help="number of test samples (default: %(default)s)")  # fmt: skip
    add("--preset", choices=tuple(PRESETS), default=DEFAULT.preset,
        help="sizes of the network's layers (default: %(default)s)")  # fmt: skip
    add("--epochs", type=positive, default=DEFAULT.epochs, metavar="N",
        help="number of epochs to train (default: %(default)s)")  # fmt: skip
    add("--patience", type=natural, default=DEFAULT.patience, metavar="N",
        help="number of epochs without a better test accuracy after which a training stops, as in the paper; 0: never "
        "(default: %(default)s)")  # fmt: skip
    add("--plain-images", dest="augment", action="store_false",
        help="change training images only by the random crops of the paper (default: colours and depth are changed at "
        "random too, and crops are shifted further)")  # fmt: skip
    add("--learning-rate", type=positive_number, default=DEFAULT.learning_rate, metavar="R",
        help="learning rate of Adam at the start of the training, above 0 (default: %(default)s)")  # fmt: skip


def group_of(arguments: argparse.Namespace) -> str:
    """Return the name of the symmetry group that the options --model and --group choose together.

    Args:
        arguments: Options of the command; both are None if the user does not give them.

    Raises:
        UsageError: If the two options contradict each other.
    """
    model, group = arguments.model, arguments.group
    if model and group and (model == "cnn") != (group == "none"):
        raise UsageError(f"--model {model} and --group {group} contradict each other")
    return group or ("none" if model == "cnn" else DEFAULT.group)
