"""``svfl-data validate``: check a dataset or an episode for errors."""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator

from svfl_data.checks import Finding, check_dataset, check_file
from svfl_data.commands.arguments import add_path
from svfl_data.commands.source import is_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.system.command_line import Commands, add_json, report
from svfl_data.system.printable import say
from svfl_data.system.progress import progress


def add(commands: Commands) -> None:
    """Add the command ``validate`` and its arguments to the command line."""
    parser = commands.add_parser(
        "validate",
        help="check for errors: damage, clocks, sensors, images, actions, labels",
        description="Check a dataset or an episode for errors: seal (checksum), schema, timestamps (order, gaps, "
        "jitter, steps), force (saturated, stuck, tare), images (black, frozen, depth holes), actions, poses, labels. "
        "Every finding names episode, field, row and severity. The exit code is 1 if a finding is an error, or with "
        "--strict a warning, and otherwise 0.",
        example="svfl-data validate data/centering\n"
        "svfl-data validate data/centering --strict   # warnings fail as well\n"
        "svfl-data validate data/centering --json | jq '.findings[] | select(.severity == \"error\")'",
    )
    add_path(parser)
    parser.add_argument(
        "--strict", action="store_true", help="fail if a finding is a warning, too (default: only errors fail)"
    )
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Check the dataset or the episode, and print the findings.

    Args:
        arguments: Parsed arguments of the command.

    Raises:
        DatasetError: If there is an error among the findings, or with --strict a warning, so that the command fails.
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
        report(True, {**totals, "findings": findings})
    summary = f"{_counted(kinds['error'], 'error')}, {_counted(kinds['warning'], 'warning')}"
    if kinds["error"] or (arguments.strict and kinds["warning"]):
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
