"""The command ``svfl-train rerun``, which repeats a run with the settings in its folder."""

import argparse
from pathlib import Path

from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands, Parser
from svfl_data.system.printable import printable
from svfl_models.configuration.yaml_file import PROGRAM, read_yaml

EXAMPLE = """\
svfl-train rerun out/bc_picking
svfl-train rerun out/bc_picking --out out/bc_picking_seed1 --set seed=1"""
SETTINGS = "run.yaml"


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser: Parser = commands.add_parser(
        "rerun", help="repeat a training or an experiment with the settings in its folder", example=EXAMPLE,
        description="Repeat a training or an experiment with the settings in run.yaml of its folder, and write it to a "
        "new folder. The result is the same on the same machine with the same versions.",
    )  # fmt: skip
    add = parser.add_argument
    add("run", type=Path, metavar="FOLDER", help="folder of the run to repeat")
    add("--set", action="append", default=[], dest="assignments", metavar="NAME=VALUE",
        help="new value of a setting; can be given several times (default: none)")  # fmt: skip
    add("--out", type=Path, metavar="FOLDER",
        help="folder to write the new run to (default: that of the run with _rerun at the end)")  # fmt: skip
    parser.set_defaults(command=lambda arguments: run(arguments, commands))


def run(arguments: argparse.Namespace, commands: Commands) -> None:
    """Do a run again.

    Args:
        arguments: Options of the command.
        commands: Commands of ``svfl-train``, of which the one that did the run is called.

    Raises:
        UsageError: If the folder holds no settings of a command that can be repeated.
        SvflError: If the run fails.
    """
    file = arguments.run / SETTINGS
    if not file.is_file():
        raise UsageError(f"{arguments.run}: holds no {SETTINGS}; it is written by the trainings of svfl-train")
    program = read_yaml(file).get(PROGRAM)
    parser = commands.choices.get(str(program))
    if parser is None or "--print-config" not in parser._option_string_actions:
        raise UsageError(f"{file}: is of {printable(program, 40)}, which is no training of svfl-train")
    out = arguments.out or arguments.run.with_name(f"{arguments.run.name}_rerun")
    words = ["--config", str(file), "--out", str(out)]
    again = parser.parse_args(words + [word for one in arguments.assignments for word in ("--set", one)])
    again.command(again)
