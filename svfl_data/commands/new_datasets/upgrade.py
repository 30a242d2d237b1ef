"""``svfl-data upgrade``: make a new dataset of the present episode format from an old one."""

import argparse

from svfl_data.commands.arguments import add_dataset, add_new
from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance.upgrade import upgrade
from svfl_data.storage.header import FORMAT_VERSION
from svfl_data.system.command_line import Commands, add_json, report
from svfl_data.system.printable import printable

MOST_NAMED = 20
"""Largest number of arrays or files that are named; of others only their number."""


def add(commands: Commands) -> None:
    """Add the command ``upgrade`` and its arguments to the command line."""
    parser = commands.add_parser(
        "upgrade",
        help="make a new dataset of the present episode format from an old one",
        description=f"Make a new dataset of episode format {FORMAT_VERSION} from one of format 1.0, which is not "
        "changed. Episodes keep their numbers, metadata and places in shards; splits, statistics, failed attempts and "
        "unfinished recordings are copied. The history of every episode states the seal (checksum) that it had "
        "before. Arrays outside extra/ that format 1.0 did not define are left out and named. The command ends with an "
        "error, and writes nothing, if an episode is damaged.",
        example="svfl-data upgrade data/centering data/centering_2",
    )
    add_dataset(parser)
    add_new(parser)
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Upgrade the dataset, and say what was done."""
    made = upgrade(Dataset.open(arguments.path), arguments.destination)
    kept = f", {made.current} of which were so already" if made.current else ""
    lines = [f"{arguments.destination}: {made.episodes} episodes in format {FORMAT_VERSION}{kept}"]
    if made.left_out:
        named = [f"{printable(path, 80)} ({count})" for path, count in sorted(made.left_out.items())]
        lines.append(f"left out, since format 1.0 does not define them (number of episodes): {_some(named)}")
    if made.journals:
        command = f"svfl-data repair {arguments.destination}"
        lines.append(f"unfinished recordings: {made.journals}; {command} makes episodes of them")
    if made.others:
        names = [printable(name, 80) for name in made.others]
        lines.append(f"not copied, since they are no part of a dataset: {_some(names)}")
    report(arguments.json, {"path": arguments.destination} | vars(made), *lines)


def _some(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
