"""``svfl-data repair``: repair a dataset after killed processes, power cuts and damage."""

import argparse

from svfl_data.commands.arguments import add_dataset
from svfl_data.errors import SvflError
from svfl_data.maintenance.repair import RepairAction, repair_dataset, repair_exit_code
from svfl_data.system.command_line import Commands, add_json, report


class LossError(SvflError):
    """Error that is raised after a repair in which readings or files were lost; the rest of the dataset is repaired."""


def add(commands: Commands) -> None:
    """Add the command ``repair`` and its arguments to the command line."""
    parser = commands.add_parser(
        "repair",
        help="recover interrupted recordings, and move damaged files to a folder of their own",
        description="Make episodes of recordings that were interrupted, such as by a killed process or a power cut, "
        "and move damaged files to the folder damaged/ of the dataset. No data are deleted, and a second run changes "
        "nothing more. The exit code is 0 if nothing was lost, 3 if something was lost and something was saved, and 1 "
        "if nothing could be saved.",
        example="svfl-data repair data/week\n"
        "svfl-data repair data/week --reseal   # after editing files with other software",
    )
    add_dataset(parser)
    parser.add_argument(
        "--reseal", action="store_true",
        help="give a new seal (checksum) to valid episode files that other software has changed and left without a "
        "seal (default: they count as damaged)",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Repair the dataset, and print the actions.

    Args:
        arguments: Parsed arguments of the command.

    Raises:
        LossError: If readings or files were lost. Its exit code is 3 if others were saved, and 1 if nothing was saved.
    """
    actions = repair_dataset(arguments.path, arguments.reseal)
    lines = [f"{action.done}: {action.path}: {action.detail}" for action in actions]
    report(arguments.json, {"actions": actions}, *(lines or [f"{arguments.path}: in order, nothing to do"]))
    if code := repair_exit_code(actions):
        problem = LossError(_loss_words(arguments, actions))
        problem.exit_code = code
        raise problem


def _loss_words(arguments: argparse.Namespace, actions: list[RepairAction]) -> str:
    lost = [action for action in actions if action.lost]
    names = ", ".join(action.path.name for action in lost[:3]) + (", ..." if len(lost) > 3 else "")
    return f"{arguments.path}: readings or files were lost: {names}"
