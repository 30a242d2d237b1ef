"""``svfl-collect centering``: collect labelled samples of block centering."""

import argparse
import time

from collectors.commands.options import add_collection, add_world, executor, tell_datasets, world
from svfl_data.system.command_line import Commands, between, positive


def add(commands: Commands) -> None:
    """Add ``centering`` to the commands of the command line."""
    parser = commands.add_parser(
        "centering",
        help="collect labelled samples of block centering, in which one finger collides with a block",
        description="Collect block-centering samples in simulation: one finger of an open gripper lands on a block, "
        "and the label states in which direction and how far the gripper must move. After an interruption, the same "
        "command continues; a larger --episodes extends the dataset.",
        example="svfl-collect centering --episodes 200 --seed 0 --workers 2 --out data/centering\n"
        "svfl-collect centering --episodes 1000 --border 0 --sensor-noise none --out data/centering_hard",
    )
    parser.add_argument(
        "--episodes", type=positive, default=200, metavar="N",
        help="number of episodes in the dataset, each of which is a sample (default: %(default)s)",
    )  # fmt: skip
    add_collection(parser)
    parser.add_argument(
        "--border", type=between(0, 40, "an angle in degrees"), default=5.0, metavar="DEG",
        help="smallest angle between the direction of a sample and the border between two classes, deg, between 0 and "
        "40; with 0 the classes are hardest to tell apart (default: %(default)g)",
    )  # fmt: skip
    add_world(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Collect the samples that the dataset lacks, and print a summary of the dataset."""
    from collectors.recording.collection import collect_dataset
    from collectors.recording.live_view import watched
    from collectors.simulation.centering import CenteringConfig
    from collectors.sources.centering import TASK, CenteringCollector, summary
    from svfl_data.datasets.dataset import Dataset

    where = executor(arguments)
    collector = CenteringCollector(arguments.seed, CenteringConfig(border_deg=arguments.border), world(arguments))
    dataset = Dataset.create_or_resume(arguments.out, TASK, arguments.seed, collector.config())
    start = time.perf_counter()
    done = collect_dataset(dataset, arguments.episodes, arguments.workers, watched(arguments, collector), where)
    seconds = time.perf_counter() - start
    facts, lines = summary(dataset)
    if done:
        rate = sum(finished.steps for finished in done) / seconds
        lines = [f"collected {len(done)} samples in {seconds:.0f} s ({rate:.0f} steps/s)", *lines]
    tell_datasets(arguments, [(facts | {"collected": len(done)}, lines)])
