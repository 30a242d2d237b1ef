"""``svfl-data card``: write a dataset card."""

import argparse
from pathlib import Path

from svfl_data.commands.source import add_dataset
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands
from svfl_data.system.printable import say


def add(commands: Commands) -> None:
    """Add the command ``card`` and its arguments to the command line."""
    parser = commands.add_parser(
        "card",
        help="a dataset card in Markdown, with figures and pictures",
        description="Write a dataset card in Markdown: figures, streams with units, distributions, one episode as a "
        "picture, where it came from. The pictures stand in a folder beside it.",
        example="svfl-data card data/centering   # writes data/centering/README.md",
    )
    add_dataset(parser)
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="file to write (default: README.md in the dataset)")
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Write the dataset card and its pictures."""
    out = arguments.out or arguments.path / "README.md"
    if out.suffix != ".md":
        raise UsageError(f"--out {out}: the name must end in .md")
    from svfl_data.reports.dataset_card import write_card

    files = write_card(Dataset.open(arguments.path), out)
    say("wrote " + ", ".join(map(str, files)))
