"""``svfl-collect replay``: simulate an episode again and compare it with the record."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, natural
from svfl_data.system.printable import say


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
    parser.add_argument("path", type=Path, metavar="DATASET", help="dataset folder, or episode file (.hdf5)")
    parser.add_argument(
        "--episode", type=natural, metavar="K",
        help="number of the episode, if DATASET is a folder; at least 0 (default: the first one)",
    )  # fmt: skip
    parser.add_argument(
        "--robot", metavar="NAME",
        help="simulated robot that carries out the recorded actions (default: the robot of the episode)",
    )  # fmt: skip
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Simulate an episode again, and print its differences from the record.

    Args:
        arguments: Parsed options of the command.

    Raises:
        DatasetError: If there are any differences.
        UsageError: If no robot has the name.
    """
    from collectors.robots import make
    from collectors.sources.replay import replay
    from svfl_data.commands.source import read
    from svfl_data.errors import DatasetError

    robot = make(arguments.robot) if arguments.robot else None
    episode = read(arguments.path, arguments.episode)
    found = replay(episode, robot)
    for path, difference in found.differences.items():
        field = episode.declarations.at(path)
        say(f"  {difference:<10.3g} {path}" + (f" [{field.unit}]" if field else ""))
    versions = ", ".join(f"{name} {recorded}, here {here}" for name, (recorded, here) in found.versions.items())
    recorded_with = f"; recorded with {versions}" if versions else ""
    if found.exact:
        say(f"{episode.name}: exact, {len(episode)} steps{recorded_with}")
        return
    differing = [f"{path} by {value:.3g}" for path, value in found.differences.items() if value]
    scene = [] if found.scene else ["another scene is drawn"]
    raise DatasetError(f"{episode.name}: differs when simulated again: {', '.join(scene + differing)}{recorded_with}")
