"""Options of a training that several commands share beside its settings."""

import argparse
import math
from pathlib import Path
from typing import Any

from svfl_data.errors import UsageError
from svfl_data.system.command_line import Parser
from svfl_models.centering.config import MODELS


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


def add_model(parser: Parser) -> None:
    """Add the option --model, which says in the paper's words whether the network is symmetric."""
    parser.add_argument("--model", choices=MODELS,
        help="kind of network: svfl is symmetric; cnn is the baseline without symmetry, the same as --group none "
        "(default: svfl)")  # fmt: skip


def add_out(parser: Parser, default: str) -> None:
    """Add the option --out, which names the folder of the run.

    Args:
        parser: Parser of the command.
        default: Folder that is used without the option, in words.
    """
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=f"folder to write the run to (default: {default})")


def with_model(given: dict[str, Any], arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given settings with the symmetry group that --model stands for, unless a group is given.

    Args:
        given: Settings that the user gives.
        arguments: Other options of the command.

    Raises:
        UsageError: If --model and the group contradict each other.
    """
    model, group = arguments.model, given.get("group")
    if model and group and (model == "cnn") != (group == "none"):
        raise UsageError(f"--model {model} and --group {group} contradict each other")
    return given | {"group": "none"} if model == "cnn" else given
