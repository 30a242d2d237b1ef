"""``svfl-data view``: show episodes in Rerun's viewer."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from svfl_data.commands.arguments import add_path
from svfl_data.commands.source import is_episode, reader
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import UsageError
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.command_line import Commands, natural, port
from svfl_data.system.printable import say

if TYPE_CHECKING:
    from svfl_data.viewer.entities.episode_source import EpisodeSource
    from svfl_data.viewer.predictions import Prediction

MOST = 6
"""Largest number of episodes that are shown side by side."""
LOOPBACK = "127.0.0.1"
PORT = 9090


def add(commands: Commands) -> None:
    """Add the command ``view`` and its arguments to the command line."""
    parser = commands.add_parser(
        "view",
        help="show episodes: arm, images, forces over time, contacts, labels, predictions of a network",
        description="Show episodes in Rerun's viewer: the arm in 3-D, images and point cloud, forces over time with "
        "contacts and labels, commanded and achieved actions, and the predictions of a trained network. Several "
        "episodes are shown side by side. With --compare, the distributions of the forces and torques of two datasets "
        "are shown instead.",
        example="svfl-data view data/centering --episode 3\n"
        "svfl-data view data/block_picking --episode 0 4 9            # side by side\n"
        "svfl-data view data/centering --episode 3 --checkpoint runs/vf/checkpoint.ckpt\n"
        "svfl-data view data/centering --episode 3 --web              # in a browser of this machine\n"
        "svfl-data view data/centering --episode 3 --out episode.rrd   # later: rerun episode.rrd\n"
        "svfl-data view data/block_picking --compare data/mine",
    )
    add_path(parser)
    parser.add_argument(
        "--episode", type=natural, nargs="+", default=[], metavar="N",
        help="number of the episode, if PATH is a dataset folder; at least 0; several, but at most "
        f"{MOST}, are shown side by side (default: the first one)",
    )  # fmt: skip
    parser.add_argument(
        "--checkpoint", type=Path, metavar="FILE",
        help="file of a trained network, whose predictions are shown as well (default: none)",
    )  # fmt: skip
    parser.add_argument(
        "--compare", type=Path, metavar="DATASET",
        help="folder of a second dataset; compare the forces of both instead of showing episodes (default: none)",
    )  # fmt: skip
    parser.add_argument(
        "--urdf", type=Path, metavar="FILE", help="URDF file of the arm (default: that of the Panda, for its episodes)"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--out", type=Path, metavar="FILE.rrd",
        help="file to write for the viewer, instead of opening it; its name ends in .rrd (default: the viewer "
        "opens)",
    )  # fmt: skip
    where.add_argument("--web", action="store_true", help="serve the viewer to a web browser (default: a window opens)")
    parser.add_argument(
        "--bind", default=LOOPBACK, metavar="ADDRESS",
        help="with --web: IP address to listen on; 0.0.0.0 listens on all addresses of this machine (default: "
        "%(default)s, which only this machine can reach)",
    )  # fmt: skip
    parser.add_argument(
        "--port", type=port, default=PORT, metavar="P",
        help="with --web: TCP port of the page; the next port, P + 1, serves the data (default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Show the episodes or the comparison of two datasets, or save them in a file for the viewer.

    Args:
        arguments: Parsed arguments of the command.

    Raises:
        UsageError: If options do not fit together.
    """
    if arguments.out and arguments.out.suffix != ".rrd":
        raise UsageError(f"--out {arguments.out}: the name must end in .rrd")
    if arguments.compare and (arguments.episode or arguments.checkpoint):
        raise UsageError("--compare shows whole datasets; leave --episode and --checkpoint out")
    os.environ["CI"] = "1"  # the only way to stop Rerun from sending usage statistics without changing its settings
    from svfl_data.viewer import compare, show

    if arguments.compare:
        content = compare.content(Dataset.open(arguments.path), Dataset.open(arguments.compare))
    else:
        content = show.content(_episodes(arguments), arguments.urdf)
    if arguments.out:
        show.save(content, arguments.out)
        say(f"viewer file {arguments.out}")
        say(f"open it     {show.command_to_open(arguments.out)}")
    elif arguments.web:
        show.serve(content, arguments.bind, arguments.port)
    else:
        show.show(content)


def _episodes(arguments: argparse.Namespace) -> "Sequence[tuple[EpisodeSource, Prediction | None]]":
    """Return the requested episodes, each with the prediction of the network, or None without a network."""
    from svfl_data.viewer import predictions
    from svfl_data.viewer.entities.episode_source import EpisodeSource

    network = predictions.load(arguments.checkpoint) if arguments.checkpoint else None
    readers = _readers(arguments.path, list(dict.fromkeys(arguments.episode)))
    roots = [f"episode_{one.meta.index}/" if len(readers) > 1 else "" for one in readers]
    return [
        (EpisodeSource.of(one, root), network(one.load()) if network else None)
        for one, root in zip(readers, roots, strict=True)
    ]


def _readers(path: Path, episodes: Sequence[int]) -> list[EpisodeReader]:
    if len(episodes) > MOST:
        raise UsageError(f"--episode: {len(episodes)} episodes; at most {MOST} fit beside each other")
    if is_episode(path):
        return [reader(path, episodes[0] if episodes else None)]
    if not episodes:
        return [reader(path, None)]
    dataset = Dataset.open(path)
    return [dataset.episode(index) for index in episodes]
