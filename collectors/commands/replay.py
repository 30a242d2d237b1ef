"""``svfl-collect replay``: simulate an episode again and compare it with the recording."""

import argparse

from collectors.robots import make, robots
from svfl_data.commands.arguments import add_episode, add_path
from svfl_data.system.command_line import Commands, add_json, complete_with, report


def add(commands: Commands) -> None:
    """Add ``replay`` to the commands of the command line."""
    parser = commands.add_parser(
        "replay",
        help="simulate an episode again from its seed and actions, and compare it with the record",
        description="Simulate an episode again from its configuration, seed and actions, and print the largest "
        "difference in every array. On the same machine with the same versions of the software there is no "
        "difference. The exit code is 1 if there is one.",
        example="svfl-collect replay data/block_picking --episode 3",
    )
    add_path(parser)
    add_episode(parser)
    robot = parser.add_argument(
        "--robot", metavar="NAME",
        help="robot, a simulated one, that executes the recorded actions (default: the robot of the episode)",
    )  # fmt: skip
    complete_with(robot, robots)
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Simulate an episode again, and print its differences from the record.

    Args:
        arguments: Parsed options of the command.

    Raises:
        DatasetError: If there are any differences.
        UsageError: If no robot has the name.
    """
    from collectors.sources.replay import replay
    from svfl_data.commands.source import read
    from svfl_data.errors import DatasetError

    robot = make(arguments.robot) if arguments.robot else None
    episode = read(arguments.path, arguments.episode)
    found = replay(episode, robot)
    lines = []
    for path, difference in found.differences.items():
        field = episode.declarations.at(path)
        lines.append(f"  {difference:<10.3g} {path}" + (f" [{field.unit}]" if field else ""))
    versions = ", ".join(f"{name} {recorded}, here {here}" for name, (recorded, here) in found.versions.items())
    recorded_with = f"; recorded with {versions}" if versions else ""
    if found.exact:
        lines.append(f"{episode.name}: exact, {len(episode)} steps{recorded_with}")
    facts = {"episode": episode.name, "steps": len(episode), "exact": found.exact, "same_scene": found.scene}
    facts |= {"differences": found.differences, "versions": found.versions}
    report(arguments.json, facts, *lines)
    if found.exact:
        return
    differing = [f"{path} by {value:.3g}" for path, value in found.differences.items() if value]
    scene = [] if found.scene else ["another scene is drawn"]
    raise DatasetError(f"{episode.name}: differs when simulated again: {', '.join(scene + differing)}{recorded_with}")
