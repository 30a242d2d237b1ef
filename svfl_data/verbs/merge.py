"""``svfl-data merge``: several datasets into one."""

import argparse
from pathlib import Path

from svfl_data.cli import Commands
from svfl_data.dataset import Dataset
from svfl_data.merge import merge
from svfl_data.printable import say


def add(commands: Commands) -> None:
    """Put the verb on the command line."""
    verb = commands.add_parser(
        "merge",
        help="several datasets into a new one",
        description="Copy the episodes of several datasets into a new one, numbered from 0. Every episode's history "
        "says which dataset, number and seed it had. Datasets whose cameras, streams or rates differ are refused.",
        example="svfl-data merge data/monday data/tuesday data/week",
    )
    verb.add_argument("sources", type=Path, nargs="+", metavar="SRC", help="dataset folders")
    verb.add_argument("destination", type=Path, metavar="DST", help="new dataset folder")
    verb.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Merge."""
    count = merge([Dataset.open(source) for source in arguments.sources], arguments.destination)
    say(f"{arguments.destination}: {count} episodes from {len(arguments.sources)} datasets")
