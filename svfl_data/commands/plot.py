"""``svfl-data plot``: draw one picture of an episode."""

import argparse
from pathlib import Path

from svfl_data.commands.arguments import add_episode, add_path
from svfl_data.commands.source import read
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands, add_json, report


def add(commands: Commands) -> None:
    """Add the command ``plot`` and its arguments to the command line."""
    parser = commands.add_parser(
        "plot",
        help="draw a picture of an episode: images, force, torque, gripper, actions, contacts, label",
        description="Draw a picture of an episode and write it as a PNG file. It shows images, force, torque, gripper "
        "opening, actions and fields of your own over time, with contacts and other annotations, and the label as an "
        "arrow in the last image.",
        example="svfl-data plot data/centering --episode 3 --out episode.png",
    )
    add_path(parser)
    add_episode(parser)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.png",
        help="file to write, a PNG picture; its name ends in .png",
    )
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Draw the picture and write it to a PNG file."""
    if arguments.out.suffix != ".png":
        raise UsageError(f"--out {arguments.out}: the name must end in .png")
    from svfl_data.reports import plot

    plot.save(read(arguments.path, arguments.episode), arguments.out)
    report(arguments.json, {"file": arguments.out}, f"wrote {arguments.out}")
