"""``svfl-data card``: write a dataset card."""

import argparse
from pathlib import Path

from svfl_data.commands.arguments import add_dataset
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands, add_json, report


def add(commands: Commands) -> None:
    """Add the command ``card`` and its arguments to the command line."""
    parser = commands.add_parser(
        "card",
        help="write a dataset card in Markdown, with statistics and pictures",
        description="Write a dataset card in Markdown. It holds counts, the streams with their units, distributions, a "
        "picture of one episode, and the origin of the data. The pictures are written to a folder beside the card.",
        example="svfl-data card data/centering   # writes data/centering/README.md",
    )
    add_dataset(parser)
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md",
        help="file to write, in Markdown; its name ends in .md (default: README.md in the dataset folder)",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Write the dataset card and its pictures."""
    out = arguments.out or arguments.path / "README.md"
    if out.suffix != ".md":
        raise UsageError(f"--out {out}: the name must end in .md")
    from svfl_data.reports.dataset_card import write_card

    files = write_card(Dataset.open(arguments.path), out)
    report(arguments.json, {"files": files}, "wrote " + ", ".join(map(str, files)))
