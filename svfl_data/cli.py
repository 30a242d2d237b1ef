"""The command ``svfl-data``, which shows and checks recorded data, changes its metadata and makes new datasets."""

import sys

from svfl_data.commands import card, completion, info, plot, relabel, repair, split, stats, topdown, validate, view
from svfl_data.commands.new_datasets import filter as filter_
from svfl_data.commands.new_datasets import merge, pack, upgrade
from svfl_data.system.command_line import Parser
from svfl_data.system.command_line import main as run

PROGRAM = "svfl-data"
COMMANDS = (
    info, view, plot, topdown, validate, repair, relabel, filter_, merge, split, stats, pack, upgrade, card, completion,
)  # fmt: skip


def main() -> int:
    """Parse the command line, run its command and return the exit code."""
    return run(build_parser())


def build_parser() -> Parser:
    """Return the command-line parser of ``svfl-data``."""
    root = Parser(
        prog=PROGRAM,
        description="Show and check recorded datasets, change their metadata, and make new datasets from them.",
        example=f"{PROGRAM} view data/centering --episode 3\n{PROGRAM} validate data/centering",
    )
    commands = root.add_commands()
    for command in COMMANDS:
        command.add(commands)
    return root


if __name__ == "__main__":
    sys.exit(main())
