"""``svfl-data merge``: copy the episodes of several datasets into a new dataset."""

import argparse
from pathlib import Path

from svfl_data.commands.source import add_allowances, left_out_words
from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance.merge import merge
from svfl_data.system.command_line import Commands
from svfl_data.system.printable import say


def add(commands: Commands) -> None:
    """Add the command ``merge`` and its arguments to the command line."""
    parser = commands.add_parser(
        "merge",
        help="copy the episodes of several datasets into a new dataset",
        description="Copy the episodes of several datasets into a new dataset, where they are numbered from 0. The "
        "history of every copied episode states the dataset, number and seed that it had before. The command ends "
        "with an error, and writes nothing, if cameras (names, sizes, calibration), workspaces, streams or rates of "
        "the episodes differ, or if two episodes are copies of one recording.",
        example="svfl-data merge data/monday data/tuesday data/week\n"
        "svfl-data merge data/monday data/tuesday data/week --varies cameras/front/T_base_camera --once",
    )
    parser.add_argument("sources", type=Path, nargs="+", metavar="SRC", help="dataset folders to copy from")
    parser.add_argument("destination", type=Path, metavar="DST", help="folder of the new dataset, absent or empty")
    add_allowances(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Merge the datasets."""
    sources = [Dataset.open(source) for source in arguments.sources]
    count, left_out = merge(sources, arguments.destination, arguments.varies, arguments.once)
    say(f"{arguments.destination}: {count} episodes from {len(sources)} datasets{left_out_words(left_out)}")
