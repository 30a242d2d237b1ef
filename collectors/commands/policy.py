"""``svfl-collect policy``: record episodes of a trained policy, and print its success rate."""

import argparse
from pathlib import Path

from collectors.commands.options import add_collection, add_world, executor, world
from collectors.tasks import TASKS
from svfl_data.system.command_line import Commands, positive
from svfl_data.system.printable import say


def add(commands: Commands) -> None:
    """Add ``policy`` to the commands of the command line."""
    parser = commands.add_parser(
        "policy",
        help="record episodes of a trained policy, and print its success rate",
        description="Record episodes of a trained policy in simulated scenes that are in no demonstration, and print "
        "its success rate. Every episode is kept and counted, whether it succeeds or not. The policy takes the images "
        "of the camera that it was trained with, which must be among --cameras. svfl-train export and "
        "svfl_models.programs.exported_policy.save write .pt2 files; other packages can add further kinds of files "
        "(collectors/sources/policy.py).",
        example="svfl-collect policy --task block_picking --checkpoint policy.pt2 --episodes 100 --out data/trained",
    )
    parser.add_argument("--task", choices=list(TASKS), required=True, metavar="TASK", help=f"task: {', '.join(TASKS)}")
    parser.add_argument(
        "--checkpoint", type=Path, required=True, metavar="FILE", help="file of the trained policy, such as a .pt2 file"
    )
    parser.add_argument(
        "--episodes", type=positive, default=50, metavar="N",
        help="number of episodes in the dataset (default: %(default)s)",
    )  # fmt: skip
    add_collection(parser)
    add_world(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Record the episodes that the dataset lacks, and print the policy's success rate over the dataset."""
    from collectors.recording.collection import collect_dataset
    from collectors.recording.live_view import watched
    from collectors.sources.policy import PolicyCollector, summary
    from svfl_data.datasets.dataset import Dataset

    where = executor(arguments)
    collector = PolicyCollector(arguments.seed, arguments.task, arguments.checkpoint, world(arguments))
    _ = collector.policy  # loaded here so that an error in the policy is reported before a folder is begun
    dataset = Dataset.create_or_resume(arguments.out, arguments.task, arguments.seed, collector.config())
    collect_dataset(dataset, arguments.episodes, arguments.workers, watched(arguments, collector), where)
    say(summary(dataset))
