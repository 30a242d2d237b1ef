"""The command ``svfl-data``: look at recorded data."""

import argparse
import functools
import os
import sys
from pathlib import Path

from svfl_data.cli import Parser, natural, run
from svfl_data.dataset import Dataset
from svfl_data.episode import Episode
from svfl_data.errors import DatasetError, StorageError, SvflError, UsageError
from svfl_data.store import read_episode

PROGRAM = "svfl-data"
EPISODE_SUFFIXES = (".hdf5", ".h5")


def main() -> int:
    """Parse the command line and run it; returns the exit code."""
    arguments = build_parser().parse_args()
    return run(functools.partial(arguments.command, arguments), PROGRAM)


def build_parser() -> Parser:
    """The command line of ``svfl-data``."""
    root = Parser(
        prog=PROGRAM, description="Look at recorded data.", example=f"{PROGRAM} view data/centering --episode 3"
    )
    commands = root.add_subparsers(required=True, metavar="COMMAND")
    view = commands.add_parser(
        "view",
        help="show an episode: images, forces over time, the 3-D scene, the label",
        description="Show an episode in Rerun's viewer: images, forces over time, the 3-D scene, the label.",
        example=f"{PROGRAM} view data/centering --episode 3\n"
        f"{PROGRAM} view data/centering --episode 3 --save episode.rrd   # later: rerun episode.rrd",
    )
    view.add_argument("path", type=Path, metavar="PATH", help="dataset folder or episode file")
    view.add_argument("--episode", type=natural, metavar="N", help="episode of the dataset (default: the first)")
    view.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a file instead of opening the viewer")
    view.set_defaults(command=_view)
    return root


def _view(arguments: argparse.Namespace) -> None:
    if arguments.save and arguments.save.suffix != ".rrd":
        raise UsageError(f"--save {arguments.save}: the name must end in .rrd")
    try:
        episode = _read(arguments.path, arguments.episode)
    except OSError as error:
        raise StorageError(f"cannot read {arguments.path}: {error.strerror}") from error
    os.environ["CI"] = "1"  # the only way to keep Rerun from sending usage statistics that leaves its settings alone
    try:
        from svfl_data import viewer
    except ModuleNotFoundError as error:
        raise SvflError(f"the viewer is not installed ({error}); run: pip install 'svfl[view]'") from error
    if arguments.save:
        viewer.save(episode, arguments.save)
        print(f"wrote {arguments.save}; open it with: rerun {arguments.save}")
    else:
        viewer.show(episode)


def _read(path: Path, index: int | None) -> Episode:
    if path.is_file() or path.suffix in EPISODE_SUFFIXES:
        if index is not None:
            raise UsageError(
                f"--episode {index}: {path} is one episode already; --episode chooses from a dataset folder"
            )
        return read_episode(path)
    dataset = Dataset.open(path)
    if index is None:
        if not dataset.indices:
            raise DatasetError(f"{path}: the dataset has no episodes yet")
        index = dataset.indices[0]
    return dataset.read(index)


if __name__ == "__main__":
    sys.exit(main())
