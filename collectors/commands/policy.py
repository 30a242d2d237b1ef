"""``svfl-collect policy``: record episodes of a trained policy, and print its success rate."""

import argparse
from pathlib import Path

from collectors.commands.options import ANY, add_collection, add_world, executor, real_robot, tell_datasets, world
from collectors.tasks import TASKS, task_class
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands, complete_with, positive


def add(commands: Commands) -> None:
    """Add ``policy`` to the commands of the command line."""
    parser = commands.add_parser(
        "policy",
        help="record episodes of a trained policy, and print its success rate",
        description="Record episodes of a trained policy, on a robot or in simulated scenes that are in no "
        "demonstration, and print its success rate. Every episode is kept and counted, whether it succeeds or not. The "
        "cameras on whose images the policy was trained must be among --cameras. svfl-train export writes .pt2 "
        "files; other packages can add further kinds of files (collectors/sources/policy.py). On a robot that is not "
        "simulated, the success is not measured: all episodes are marked as no success, until svfl-data relabel "
        "changes it.",
        example="svfl-collect policy --task block_picking --checkpoint policy.pt2 --episodes 100 --out data/trained\n"
        "svfl-collect policy --task wiping --robot my_arm --checkpoint policy.pt2 --max-steps 400 --out data/tried",
    )
    task = parser.add_argument(
        "--task", required=True, metavar="TASK",
        help=f"task: {', '.join(TASKS)}; or any name, with a robot that is not simulated",
    )  # fmt: skip
    complete_with(task, lambda: TASKS)
    parser.add_argument(
        "--checkpoint",
        type=Path,
        required=True,
        metavar="FILE",
        help="file of a trained network, such as a .pt2 file",
    )
    parser.add_argument(
        "--episodes", type=positive, default=50, metavar="N",
        help="number of episodes in the dataset (default: %(default)s)",
    )  # fmt: skip
    add_collection(parser)
    add_world(parser, ANY)
    parser.add_argument(
        "--max-steps", type=positive, metavar="N",
        help="with a robot that is not simulated: number of actions after which an episode ends, unless the policy "
        "ends it before (default: 50, which is that of simulated episodes)",
    )  # fmt: skip
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Record the episodes that the dataset lacks, and print the policy's success rate over the dataset."""
    from collectors.recording.collection import collect_dataset
    from collectors.recording.live_view import watched
    from collectors.sources.policy import PolicyCollector, summary
    from svfl_data.datasets.dataset import Dataset

    robot = real_robot(arguments)
    if robot is not None:
        _on_robot(arguments, robot)
        return
    task_class(arguments.task)
    if arguments.max_steps:
        raise UsageError("--max-steps is for robots that are not simulated; simulated episodes end after 50 actions")
    where = executor(arguments)
    collector = PolicyCollector(arguments.seed, arguments.task, arguments.checkpoint, world(arguments))
    _ = collector.policy  # loaded here so that an error in the policy is reported before a folder is begun
    dataset = Dataset.create_or_resume(arguments.out, arguments.task, arguments.seed, collector.config())
    done = collect_dataset(dataset, arguments.episodes, arguments.workers, watched(arguments, collector), where)
    facts, lines = summary(dataset)
    tell_datasets(arguments, [(facts | {"collected": len(done)}, lines)])


def _on_robot(arguments: argparse.Namespace, robot: str) -> None:
    """Record the episodes that the dataset lacks on a robot that is not simulated, one after the other.

    Raises:
        UsageError: If several workers, or another executor, are to share the robot.
    """
    from collectors.recording.collection import collect_dataset
    from collectors.recording.live_view import watched
    from collectors.sources.robot_policy import RobotPolicyCollector, summary
    from collectors.tasks.task import MAX_STEPS
    from svfl_data.datasets.dataset import Dataset

    if arguments.workers != 1 or arguments.executor != "processes":
        raise UsageError(f"robot {robot} is not simulated: one worker of this machine moves it")
    steps = arguments.max_steps or MAX_STEPS
    collector = RobotPolicyCollector(arguments.seed, arguments.task, arguments.checkpoint, robot, steps)
    _ = collector.policy, collector.opened  # so that their errors are reported before a folder is begun
    try:
        dataset = Dataset.create_or_resume(arguments.out, arguments.task, arguments.seed, collector.config())
        shown = watched(arguments, collector)
        done = collect_dataset(
            dataset, arguments.episodes, 1, shown, lambda missing, _, worker: map(worker.collect, missing)
        )
    finally:
        collector.close()
    facts, lines = summary(dataset)
    tell_datasets(arguments, [(facts | {"collected": len(done)}, lines)])
