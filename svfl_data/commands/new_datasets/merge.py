"""``svfl-data merge``: copy the episodes of several datasets into a new dataset."""

import argparse
from pathlib import Path

from svfl_data.commands.arguments import add_allowances, add_new, left_out_words
from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance.merge import merge
from svfl_data.system.command_line import Commands, add_json, report


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
    parser.add_argument("sources", type=Path, nargs="+", metavar="DATASET", help="dataset folders to copy from")
    add_new(parser)
    add_allowances(parser)
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Merge the datasets."""
    sources = [Dataset.open(source) for source in arguments.sources]
    count, left_out = merge(sources, arguments.destination, arguments.varies, arguments.once)
    facts = {"path": arguments.destination, "episodes": count, "datasets": len(sources), "copies_left_out": left_out}
    words = f"{arguments.destination}: {count} episodes from {len(sources)} datasets{left_out_words(left_out)}"
    report(arguments.json, facts, words)
