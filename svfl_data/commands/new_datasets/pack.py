"""``svfl-data pack`` and ``unpack``: copy a dataset into a few large shards, or back into one file per episode."""

import argparse

from svfl_data.commands.arguments import add_dataset, add_new
from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance import pack
from svfl_data.system.command_line import Commands, add_json, positive, report

MEGABYTE = 10**6
STATES = "absent, empty, or the result of an interrupted call of this command"


def add(commands: Commands) -> None:
    """Add the commands ``pack`` and ``unpack`` and their arguments to the command line."""
    parser = commands.add_parser(
        "pack",
        help="copy a dataset into a few large shards",
        description="Copy a dataset into shards: large files that hold many episodes each, and that all commands read "
        "like episode files. The bytes of the episodes do not change. After an interruption, the same command "
        "continues.",
        example="svfl-data pack data/centering data/centering_packed --shard-mb 500",
    )
    add_dataset(parser)
    add_new(parser, STATES)
    parser.add_argument(
        "--shard-mb", type=positive, default=pack.SHARD_BYTES // MEGABYTE, metavar="MB",
        help="largest size of a shard, MB (10^6 bytes), at least 1; only a shard with a single episode may be larger "
        "(default: %(default)s)",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)
    parser = commands.add_parser(
        "unpack",
        help="copy a packed dataset into one file per episode",
        description="Copy a packed dataset into one file per episode. The files are equal, byte for byte, to those "
        "before packing. After an interruption, the same command continues.",
        example="svfl-data unpack data/centering_packed data/centering_again",
    )
    add_dataset(parser)
    add_new(parser, STATES)
    add_json(parser)
    parser.set_defaults(command=run_unpack)


def run(arguments: argparse.Namespace) -> None:
    """Pack the dataset into shards."""
    target = pack.pack(Dataset.open(arguments.path), arguments.destination, arguments.shard_mb * MEGABYTE)
    shards = len(list(target.path.glob("shard_*")))
    facts = {"path": arguments.destination, "episodes": len(target), "shards": shards}
    report(arguments.json, facts, f"{arguments.destination}: {len(target)} episodes in {shards} shards")


def run_unpack(arguments: argparse.Namespace) -> None:
    """Unpack the dataset into one file per episode."""
    target = pack.unpack(Dataset.open(arguments.path), arguments.destination)
    facts = {"path": arguments.destination, "episodes": len(target)}
    report(arguments.json, facts, f"{arguments.destination}: {len(target)} episodes in files of their own")
