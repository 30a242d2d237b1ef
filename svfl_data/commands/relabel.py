"""``svfl-data relabel``: change the success, annotations, contacts and recorded transforms of episodes."""

import argparse
import dataclasses
from collections.abc import Sequence

from svfl_data.commands.arguments import add_episode, add_path
from svfl_data.commands.source import is_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import UsageError
from svfl_data.maintenance import relabel
from svfl_data.schema.episode import Episode, Meta
from svfl_data.signals.contact import ContactRule
from svfl_data.signals.transforms import Gravity, LowPass, Tare
from svfl_data.system.command_line import Commands, Parser, add_json, report, yes_no
from svfl_data.system.progress import progress

RULE = ContactRule()


def add(commands: Commands) -> None:
    """Add the command ``relabel`` and its arguments to the command line."""
    parser = commands.add_parser(
        "relabel",
        help="change success, annotations, contacts and recorded transforms of episodes",
        description="Change the metadata of episodes; the recorded arrays stay the same. Each file is replaced as a "
        "whole or not at all, and its history gets an entry. The options --contact, --transforms and --remove can "
        "change all episodes of a dataset at once. At least one change is required.",
        example="svfl-data relabel data/week --episode 3 --success no\n"
        "svfl-data relabel data/week --episode 3 --annotate slip 0.42 0.55\n"
        "svfl-data relabel data/week --contact --threshold 3 --release 1.5\n"
        "svfl-data relabel data/week --transforms tare low_pass=40",
    )
    add_path(parser)
    add_episode(parser, otherwise="all episodes; --success and --annotate need one")
    parser.add_argument(
        "--success", type=yes_no, metavar="yes|no", help="whether the task was achieved (default: unchanged)"
    )
    parser.add_argument(
        "--annotate", nargs=3, action="append", default=[], metavar=("NAME", "START", "END"),
        help="add an annotation with this name, start and end; the times are in s on the episode clock and lie within "
        "the episode; may be given several times (default: none is added)",
    )  # fmt: skip
    parser.add_argument(
        "--remove", action="append", default=[], metavar="NAME",
        help="remove all annotations with this name; may be given several times (default: none is removed)",
    )  # fmt: skip
    parser.add_argument(
        "--transforms", nargs="+", type=transform, metavar="STEP",
        help="replace the list of transforms that are applied, in this order, whenever the raw wrench is used: tare "
        "subtracts the tare of the episode; tare=FX,FY,FZ,MX,MY,MZ subtracts these values (N, N m); low_pass=HZ "
        "filters with this corner frequency; gravity=KG,X,Y,Z subtracts the weight of this mass with its centre of "
        "mass at X,Y,Z (m, gripper axes) (default: unchanged)",
    )  # fmt: skip
    parser.add_argument(
        "--contact",
        action="store_true",
        help="find contacts in the wrench, and store them as annotations that replace those found earlier (default: "
        "unchanged)",
    )
    _add_rule(parser)
    add_json(parser)
    parser.set_defaults(command=run)


def _add_rule(parser: Parser) -> None:
    release = f"{RULE.release_n:g}, or half of --threshold"
    for option, unit, default, words in (
        ("threshold", "N", f"{RULE.threshold_n:g}", "force above which a contact begins, N, above 0"),
        ("release", "N", release, "force below which a contact ends, N, above 0 and at most the threshold"),
        ("min-duration", "S", f"{RULE.min_duration_s:g}", "shortest duration of a contact, s, at least 0"),
        ("cutoff", "HZ", f"{RULE.cutoff_hz:g}", "corner frequency of the force's low-pass filter, Hz; 0: no filter"),
    ):
        parser.add_argument(
            f"--{option}", type=float, metavar=unit, help=f"with --contact: {words} (default: {default})"
        )


def transform(text: str) -> Tare | LowPass | Gravity:
    """Parse a transform of ``--transforms``, such as ``low_pass=40``; used as an argument type."""
    name, _, values = text.partition("=")
    try:
        numbers = tuple(float(value) for value in values.split(",")) if values else ()
        if name == "tare":
            return Tare(numbers or None)
        if name == "low_pass" and len(numbers) == 1:
            return LowPass(*numbers)
        if name == "gravity" and len(numbers) == 4:
            return Gravity(numbers[0], numbers[1:])
    except (ValueError, UsageError) as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from error
    raise argparse.ArgumentTypeError(f"{text!r} is none of tare, low_pass=HZ, gravity=KG,X,Y,Z")


def run(arguments: argparse.Namespace) -> None:
    """Change the metadata of one episode or of all episodes of a dataset."""
    changes = _changes(arguments)

    def change(episode: Episode) -> Meta:
        for one in changes:
            episode = dataclasses.replace(episode, meta=one(episode))
        return episode.meta

    if is_episode(arguments.path):
        _refuse(arguments.episode is not None, "--episode chooses from a dataset folder")
        changed = int(bool(relabel.relabel_file(arguments.path, change)))
        report(
            arguments.json, {"path": arguments.path, "episodes": 1, "changed": changed}, f"{arguments.path}: relabelled"
        )
        return
    dataset = Dataset.open(arguments.path)
    if arguments.episode is None:
        _refuse(arguments.success is not None or bool(arguments.annotate), "--success and --annotate need --episode N")
    dataset.clear()
    indices: Sequence[int] = dataset.indices if arguments.episode is None else [arguments.episode]
    changed = sum(bool(relabel.relabel(dataset, index, change)) for index in progress(indices, "relabelling"))
    facts = {"path": arguments.path, "episodes": len(indices), "changed": changed}
    report(arguments.json, facts, f"{arguments.path}: {changed} of {len(indices)} episodes changed")


def _changes(arguments: argparse.Namespace) -> list[relabel.Change]:
    given = {"threshold_n": arguments.threshold, "release_n": arguments.release}
    given |= {"min_duration_s": arguments.min_duration, "cutoff_hz": arguments.cutoff}
    given = {key: value for key, value in given.items() if value is not None}
    _refuse(bool(given) and not arguments.contact, "--threshold, --release, --min-duration, --cutoff need --contact")
    if "threshold_n" in given and "release_n" not in given:
        given["release_n"] = given["threshold_n"] / 2
    changes = [relabel.without_annotations(name) for name in arguments.remove]
    changes += [] if arguments.success is None else [relabel.with_success(arguments.success)]
    changes += [relabel.with_transforms(arguments.transforms)] if arguments.transforms else []
    changes += [relabel.with_contacts(dataclasses.replace(RULE, **given))] if arguments.contact else []
    changes += [relabel.with_annotation(name, _time(start), _time(end)) for name, start, end in arguments.annotate]
    _refuse(not changes, "say what to change: --success, --annotate, --remove, --transforms or --contact")
    return changes


def _time(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise UsageError(f"--annotate: {text!r} is not a time in seconds") from error


def _refuse(wrong: bool, words: str) -> None:
    if wrong:
        raise UsageError(words)
