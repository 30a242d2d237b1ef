"""``svfl-data validate``: check a dataset or an episode for errors."""

import argparse
import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator

from svfl_data.checks import Finding, check_dataset, check_file
from svfl_data.commands.source import add_json, add_path, is_episode, print_json
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.system.command_line import Commands
from svfl_data.system.printable import say
from svfl_data.system.progress import progress


def add(commands: Commands) -> None:
    """Add the command ``validate`` and its arguments to the command line."""
    parser = commands.add_parser(
        "validate",
        help="check for errors: damage, clocks, sensors, images, actions, labels",
        description="Check a dataset or an episode for errors: seal (checksum), schema, timestamps (order, gaps, "
        "jitter, steps), force (saturated, stuck, tare), images (black, frozen, depth holes), actions, poses, labels. "
        "Every finding names episode, field, row and severity. The exit code is 1 if a finding is an error, and 0 if "
        "all are warnings or notes.",
        example="svfl-data validate data/centering\n"
        "svfl-data validate data/centering --json | jq '.findings[] | select(.severity == \"error\")'",
    )
    add_path(parser)
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Check the dataset or the episode, and print the findings.

    Args:
        arguments: Parsed arguments of the command.

    Raises:
        DatasetError: If there is an error among the findings, so that the command fails.
    """
    count, lists = _checked(arguments)
    findings: list[Finding] = []
    for found in lists:
        findings += found
        if not arguments.json:
            say(*found)
    kinds = Counter(finding.severity for finding in findings)
    if arguments.json:
        totals = {"episodes": count, "errors": kinds["error"], "warnings": kinds["warning"], "notes": kinds["note"]}
        print_json({**totals, "findings": [dataclasses.asdict(finding) for finding in findings]})
    summary = f"{_counted(kinds['error'], 'error')}, {_counted(kinds['warning'], 'warning')}"
    if kinds["error"]:
        raise DatasetError(f"{arguments.path}: {summary} in {_counted(count, 'episode')}")
    if not arguments.json:
        say(f"{arguments.path}: {_counted(count, 'episode')}, {summary}, {_counted(kinds['note'], 'note')}")


def _checked(arguments: argparse.Namespace) -> tuple[int, Iterable[list[Finding]] | Iterator[list[Finding]]]:
    if is_episode(arguments.path):
        return 1, [check_file(arguments.path)]
    dataset = Dataset.open(arguments.path)
    count = len(dataset)
    return count, progress(check_dataset(dataset), "checking", total=count + 1)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
