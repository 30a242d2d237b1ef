"""``svfl-data plot``: one picture of an episode."""

import argparse
from pathlib import Path
from types import ModuleType

from svfl_data.cli import Commands
from svfl_data.errors import SvflError, UsageError
from svfl_data.verbs.source import add_episode, add_path, read


def add(commands: Commands) -> None:
    """Put the verb on the command line."""
    verb = commands.add_parser(
        "plot",
        help="one picture of an episode: images, force, torque, gripper, actions, contacts, label",
        description="Draw an episode into a PNG: images, force, torque, gripper opening and actions over time, with "
        "contacts and other annotations, and the label as an arrow in the last image.",
        example="svfl-data plot data/centering --episode 3 --out episode.png",
    )
    add_path(verb)
    add_episode(verb)
    verb.add_argument("--out", type=Path, required=True, metavar="FILE.png", help="picture to write")
    verb.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Draw the picture."""
    if arguments.out.suffix != ".png":
        raise UsageError(f"--out {arguments.out}: the name must end in .png")
    plotting().save(read(arguments.path, arguments.episode), arguments.out)
    print(f"wrote {arguments.out}")


def plotting() -> ModuleType:
    """The module that draws, with Matplotlib.

    Raises:
        SvflError: If Matplotlib is not installed.
    """
    try:
        from svfl_data import plot
    except ModuleNotFoundError as error:
        raise SvflError(f"pictures need Matplotlib ({error}); run: pip install matplotlib") from error
    return plot
