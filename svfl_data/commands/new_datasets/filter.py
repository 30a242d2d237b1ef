"""``svfl-data filter``: copy the episodes that meet conditions into a new dataset."""

import argparse
import dataclasses
import json
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from svfl_data.commands.arguments import add_allowances, add_dataset, add_new, left_out_words
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import UsageError
from svfl_data.maintenance.merge import choose
from svfl_data.schema.episode import Episode
from svfl_data.system.command_line import Commands, add_json, report, yes_no

OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "!=": operator.ne, "<=": operator.le, ">=": operator.ge, "=": operator.eq, "<": operator.lt, ">": operator.gt,
}  # fmt: skip
CONDITION = re.compile(r"([\w.-]+?)(!=|<=|>=|=|<|>)(.*)")


@dataclass(frozen=True)
class Condition:
    """Condition that compares an attribute of an episode with a value.

    Attributes:
        key: Name of an attribute of the metadata, with dots for nested JSON values, such as ``config.world.max_move``;
            or ``steps`` or ``seconds``.
        sign: Comparison, a key of `OPERATORS`.
        value: Value to compare with.
    """

    key: str
    sign: str
    value: Any

    @classmethod
    def parse(cls, text: str) -> "Condition":
        """Parse a condition such as ``key=value``; used as an argument type.

        Args:
            text: Key, comparison and value. The value is read as JSON if it is valid JSON, otherwise as text.

        Raises:
            argparse.ArgumentTypeError: If the text has another form.
        """
        match = CONDITION.fullmatch(text)
        if not match:
            raise argparse.ArgumentTypeError(f"{text!r} is not KEY=VALUE (or !=, <, <=, >, >=)")
        key, sign, value = match.groups()
        try:
            return cls(key, sign, json.loads(value))
        except (ValueError, RecursionError):
            return cls(key, sign, value)

    def __call__(self, episode: Episode) -> bool:
        """Return whether an episode meets the condition; an episode without the attribute does not meet it."""
        value: Any = dataclasses.asdict(episode.meta) | {
            "steps": len(episode),
            "seconds": float(episode.t_ns[-1] - episode.t_ns[0]) / 1e9,
        }
        for name in self.key.split("."):
            if not isinstance(value, dict) or name not in value:
                return False
            value = value[name]
        try:
            return OPERATORS[self.sign](value, self.value)
        except TypeError:  # such as a text and a number, which have no order
            return False

    def __str__(self) -> str:
        return f"{self.key}{self.sign}{json.dumps(self.value, ensure_ascii=False)}"


def add(commands: Commands) -> None:
    """Add the command ``filter`` and its arguments to the command line."""
    parser = commands.add_parser(
        "filter",
        help="copy the episodes that meet conditions into a new dataset",
        description="Copy the episodes that meet every condition into a new dataset, where they are numbered from 0. "
        "The history of every copied episode states the number that it had before. At least one of the options "
        "--task, --success, --source, --where, --valid and --once is required.",
        example="svfl-data filter data/week data/good --success yes --source teleop\n"
        "svfl-data filter data/week data/soft --where 'config.drawn.block_friction<0.6' --where 'steps>=8'",
    )
    add_dataset(parser)
    add_new(parser)
    parser.add_argument("--task", metavar="TASK", help="task of the episodes to keep (default: all tasks)")
    parser.add_argument(
        "--success", type=yes_no, metavar="yes|no",
        help="whether the task was achieved in the episodes to keep (default: both)",
    )  # fmt: skip
    parser.add_argument(
        "--source", metavar="SOURCE",
        help="source that recorded the episodes to keep, such as expert or teleop (default: all sources)",
    )  # fmt: skip
    parser.add_argument(
        "--where", type=Condition.parse, action="append", default=[], metavar="KEY=VALUE",
        help="keep only episodes whose attribute KEY equals VALUE; comparisons are =, !=, <, <=, > and >=; KEY "
        "is steps, seconds (the duration) or an attribute of the metadata, with dots for nested ones such as "
        "config.drawn.block_friction; VALUE is JSON, or otherwise a text; may be given several times (default: no such "
        "condition)",
    )  # fmt: skip
    parser.add_argument(
        "--valid",
        action="store_true",
        help="leave out damaged episodes and episodes in which svfl-data validate finds an error (default: a damaged "
        "episode ends the command)",
    )
    add_allowances(parser)
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Copy the episodes that meet all conditions.

    Args:
        arguments: Parsed arguments of the command.

    Raises:
        UsageError: If no condition is given.
    """
    asked = {key: getattr(arguments, key) for key in ("task", "success", "source")}
    conditions = [Condition(key, "=", value) for key, value in asked.items() if value is not None] + arguments.where
    if not conditions and not arguments.once and not arguments.valid:
        raise UsageError("name a condition: --task, --success, --source, --where, --valid or --once")
    count, left_out = choose(
        Dataset.open(arguments.path),
        arguments.destination,
        lambda episode: all(condition(episode) for condition in conditions),
        [str(condition) for condition in conditions] + ["valid"] * arguments.valid,
        arguments.varies,
        arguments.once,
        arguments.valid,
    )
    facts = {"path": arguments.destination, "episodes": count, "copies_left_out": left_out}
    report(arguments.json, facts, f"{arguments.destination}: {count} episodes{left_out_words(left_out)}")
