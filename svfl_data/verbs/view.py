"""``svfl-data view``: an episode in Rerun's viewer."""

import argparse
import os
from pathlib import Path

from svfl_data.cli import Commands
from svfl_data.errors import SvflError, UsageError
from svfl_data.verbs.source import add_episode, add_path, read


def add(commands: Commands) -> None:
    """Put the verb on the command line."""
    verb = commands.add_parser(
        "view",
        help="show an episode: images, forces over time, the 3-D scene, the label",
        description="Show an episode in Rerun's viewer: images, forces over time, the 3-D scene, the label.",
        example="svfl-data view data/centering --episode 3\n"
        "svfl-data view data/centering --episode 3 --save episode.rrd   # later: rerun episode.rrd",
    )
    add_path(verb)
    add_episode(verb)
    verb.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a file instead of opening the viewer")
    verb.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Show or save the episode."""
    if arguments.save and arguments.save.suffix != ".rrd":
        raise UsageError(f"--save {arguments.save}: the name must end in .rrd")
    episode = read(arguments.path, arguments.episode)
    os.environ["CI"] = "1"  # the only way to keep Rerun from sending usage statistics that leaves its settings alone
    try:
        from svfl_data import viewer
    except ModuleNotFoundError as error:
        raise SvflError(f"the viewer is not installed ({error}); run: pip install 'svfl[view]'") from error
    if arguments.save:
        viewer.save(episode, arguments.save)
        print(f"viewer file {arguments.save}")
        print(f"open it     {viewer.command_to_open(arguments.save)}")
    else:
        viewer.show(episode)
