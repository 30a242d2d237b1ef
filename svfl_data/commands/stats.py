"""``svfl-data stats``: compute the mean and the scale of every field from the training episodes."""

import argparse

from svfl_data.commands.arguments import add_dataset
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.split import load_split
from svfl_data.sampling.statistics import TRAIN, FieldStatistics, compute_statistics, save_statistics
from svfl_data.schema.declarations import Declarations
from svfl_data.system.command_line import Commands, add_json, report


def add(commands: Commands) -> None:
    """Add the command ``stats`` and its arguments to the command line."""
    parser = commands.add_parser(
        "stats",
        help="compute mean and scale of every field from the training episodes, and store them",
        description="Compute the statistics with which the inputs of a network are normalised, from the training "
        "episodes of a stored split only, and store them beside the split. Components that a rotation mixes, such as "
        "x and y, have one scale.",
        example="svfl-data split data/centering && svfl-data stats data/centering --split default",
    )
    add_dataset(parser)
    parser.add_argument(
        "--split",
        default="default",
        metavar="NAME",
        help="split that svfl-data split has stored (default: %(default)s)",
    )
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Compute, store and print the statistics."""
    dataset = Dataset.open(arguments.path)
    dataset.clear()
    split = load_split(dataset, arguments.split)
    found = compute_statistics(dataset, split[TRAIN])
    file = save_statistics(dataset, split, found)
    declared = dataset.episode(split[TRAIN][0]).declarations
    lines = [f"{file}: {len(split[TRAIN])} training episodes"]
    for path, field in found.items():
        lines += [f"{path}, {field.count} rows [{field.unit}]", *_rows(declared, path, field)]
    report(arguments.json, {"file": file, "split_sha256": split.sha256, "fields": found}, *lines)


def _rows(declarations: Declarations, path: str, field: FieldStatistics) -> list[str]:
    declared = declarations.at(path)
    names = declared.components if declared else ()
    if len(names) != len(field.mean):
        names = tuple(map(str, range(len(field.mean)))) if len(field.mean) > 1 else ("",)
    columns = zip(names, field.mean, field.scale, field.min, field.max, strict=True)
    return [
        f"  {name:8} mean {mean:9.4g}  scale {scale:9.4g}  min {low:9.4g}  max {high:9.4g}"
        for name, mean, scale, low, high in columns
    ]
