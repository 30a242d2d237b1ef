"""``svfl-data split``: draw which episodes to train, validate and test on."""

import argparse

from svfl_data.commands.arguments import add_dataset
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.split import check_no_copies, split_episodes
from svfl_data.system.command_line import Commands, add_json, natural, report

SHARES = [("train", 0.8), ("valid", 0.1), ("test", 0.1)]


def add(commands: Commands) -> None:
    """Add the command ``split`` and its arguments to the command line."""
    parser = commands.add_parser(
        "split",
        help="draw the episodes to train, validate and test on, and store the choice",
        description="Draw which episodes to train, validate and test on, and store this split in the dataset folder, "
        "so that everyone trains and tests on the same episodes. A stored split of the same name is replaced by a "
        "different one only with --replace. The command ends with an error if the dataset holds copies of one "
        "recording, because one copy could be trained on and another one tested on.",
        example="svfl-data split data/centering --ratios train=0.8 valid=0.1 test=0.1 --seed 0",
    )
    add_dataset(parser)
    parser.add_argument(
        "--ratios", nargs="+", type=share, default=SHARES, metavar="PART=RATIO",
        help="share of the episodes that each part gets, above 0; together at most 1 (default: train=0.8 valid=0.1 "
        "test=0.1)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=natural, default=0, metavar="S", help="seed of the draw, at least 0 (default: %(default)s)"
    )
    parser.add_argument(
        "--split", default="default", metavar="NAME",
        help="split to draw, a name of letters, digits, - and _ (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--replace",
        action="store_true",
        help="replace a different stored split of the same name; run svfl-data stats again afterwards (default: a "
        "different stored split is an error)",
    )
    add_json(parser)
    parser.set_defaults(command=run)


def share(text: str) -> tuple[str, float]:
    """Parse the name of a part and its share of the episodes, such as ``train=0.8``; used as an argument type."""
    part, _, number = text.partition("=")
    try:
        return part, float(number)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not PART=RATIO, e.g. train=0.8") from error


def run(arguments: argparse.Namespace) -> None:
    """Draw and store the split."""
    dataset = Dataset.open(arguments.path)
    check_no_copies(dataset)
    dataset.clear()
    split = split_episodes(dataset.indices, dict(arguments.ratios), arguments.seed, arguments.split)
    file = split.save(dataset, arguments.replace)
    facts = {"file": file, "sha256": split.sha256, "seed": split.seed, "parts": split.parts}
    parts = ", ".join(f"{part} {len(indices)}" for part, indices in split.parts.items())
    report(arguments.json, facts, f"{file}: {parts} episodes, seed {split.seed}, sha256 {split.sha256[:12]}")
