"""``svfl-data pack`` and ``unpack``: copy a dataset into a few large shards, or back into one file per episode."""

import argparse
from pathlib import Path

from svfl_data.commands.source import add_dataset
from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance import pack
from svfl_data.system.command_line import Commands, positive
from svfl_data.system.printable import say

MEGABYTE = 10**6


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
    parser.add_argument(
        "out", type=Path, metavar="OUT",
        help="folder of the new dataset: absent, empty, or the result of an interrupted call of this command",
    )  # fmt: skip
    parser.add_argument(
        "--shard-mb", type=positive, default=pack.SHARD_BYTES // MEGABYTE, metavar="MB",
        help="largest size of a shard, MB (10^6 bytes), at least 1; only a shard with a single episode may be larger "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(command=run)
    parser = commands.add_parser(
        "unpack",
        help="copy a packed dataset into one file per episode",
        description="Copy a packed dataset into one file per episode. The files are equal, byte for byte, to those "
        "before packing. After an interruption, the same command continues.",
        example="svfl-data unpack data/centering_packed data/centering_again",
    )
    add_dataset(parser)
    parser.add_argument(
        "out", type=Path, metavar="OUT",
        help="folder of the new dataset: absent, empty, or the result of an interrupted call of this command",
    )  # fmt: skip
    parser.set_defaults(command=run_unpack)


def run(arguments: argparse.Namespace) -> None:
    """Pack the dataset into shards."""
    target = pack.pack(Dataset.open(arguments.path), arguments.out, arguments.shard_mb * MEGABYTE)
    say(f"{arguments.out}: {len(target)} episodes in {len(list(target.path.glob('shard_*')))} shards")


def run_unpack(arguments: argparse.Namespace) -> None:
    """Unpack the dataset into one file per episode."""
    target = pack.unpack(Dataset.open(arguments.path), arguments.out)
    say(f"{arguments.out}: {len(target)} episodes in files of their own")
