"""``svfl-collect expert``: record demonstrations of one task, or of all the paper's tasks, by scripted experts."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from collectors.commands.options import add_collection, add_world, executor, tell_datasets, world
from collectors.tasks import PAPER, TASKS
from svfl_data.system.command_line import Commands, between, positive

if TYPE_CHECKING:  # at run time only when collecting: the command line itself loads no simulation
    from collectors.sources.expert import ExpertCollector

ALL = "all"


def add(commands: Commands) -> None:
    """Add ``expert`` to the commands of the command line."""
    parser = commands.add_parser(
        "expert",
        help="record demonstrations of a task by its scripted expert",
        description="Record demonstrations of one task, or of all tasks of the paper, in simulation. An attempt that "
        "fails is repeated, and is not counted as a demonstration. After an interruption, the same command continues; "
        "a larger --episodes extends the dataset.",
        example="svfl-collect expert --task block_picking --episodes 50 --workers 2 --seed 0 --out data/block_picking\n"
        "svfl-collect expert --task all --episodes 50 --workers 2 --out data/tasks   # a folder for each task\n"
        "svfl-collect expert --task block_picking --cameras front,top --image-size 128 --out data/two_views\n"
        "svfl-collect expert --task block_picking --robot ur5e_sim --out data/ur5e   # the UR5e instead of the Panda\n"
        "svfl-collect expert --task block_picking --perturb 0.15 --out data/perturbed   # to clone a policy\n"
        "svfl-collect expert --task block_picking --tags --out data/tagged   # AprilTags determine success\n"
        "svfl-collect expert --task block_picking --out data/seen --rerun   # watch it, after starting: rerun\n"
        "svfl-collect expert --task block_picking --executor ray --address head:6379 --workers 64 --out data/large",
    )
    parser.add_argument(
        "--task",
        choices=[*TASKS, ALL],
        required=True,
        metavar="TASK",
        help=f"task: {', '.join(TASKS)}; or {ALL} for the nine tasks of the paper, each in its own folder in --out",
    )
    parser.add_argument(
        "--episodes", type=positive, default=50, metavar="N",
        help="number of episodes, all of them successful, in the dataset of each task (default: %(default)s)",
    )  # fmt: skip
    add_collection(parser)
    parser.add_argument(
        "--noise", type=between(0, 2, "a number"), default=1.0, metavar="X",
        help="how much the demonstrations differ, between 0 (not at all) and 2 (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--perturb", type=between(0, 1, "a number"), default=0.0, metavar="P",
        help="probability, between 0 and 1, that a random perturbation of the actions (DART) begins at an action; "
        "from such demonstrations a policy learns to recover from errors (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--tags",
        action="store_true",
        help="detect success as on a real robot, by AprilTags on the block that cameras track; only for block_picking "
        "and block_pushing (default: by the state of the simulation)",
    )
    parser.add_argument(
        "--keep-failures",
        action="store_true",
        help="write failed attempts to a second dataset, the folder failures in that of the demonstrations (default: "
        "they are not kept)",
    )
    add_world(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Collect the demonstrations that the datasets lack, and print a summary of each dataset.

    Args:
        arguments: Parsed options of the command.

    Raises:
        UsageError: If tags cannot tell the success of a task.
        DatasetError: If a folder holds another dataset.
    """
    from collectors.recording.collection import collect_dataset
    from collectors.recording.live_view import watched
    from collectors.recording.progress import CollectionProgress
    from collectors.sources.expert import summary
    from svfl_data.datasets.dataset import Dataset
    from svfl_data.datasets.dataset_info import INFO
    from svfl_data.errors import DatasetError

    if arguments.task == ALL and (arguments.out / INFO).exists():
        raise DatasetError(f"{arguments.out} holds a dataset; --task all needs a folder for one dataset of each task")
    tasks = {name: arguments.out / name for name in PAPER} if arguments.task == ALL else {arguments.task: arguments.out}
    where, config, workers = executor(arguments), world(arguments), arguments.workers
    kind = _kind(arguments.tags)
    collectors = {name: kind(arguments.seed, name, arguments.noise, arguments.perturb, config) for name in tasks}
    datasets = {
        name: Dataset.create_or_resume(tasks[name], name, arguments.seed, collector.config())
        for name, collector in collectors.items()
    }
    collected = {}
    with CollectionProgress() as progress:
        for name, collector in collectors.items():
            done = collect_dataset(
                datasets[name],
                arguments.episodes,
                workers,
                watched(arguments, collector),
                where,
                arguments.keep_failures,
                progress,
            )
            collected[name] = len(done)
    summaries = {name: summary(dataset) for name, dataset in datasets.items()}
    tell_datasets(
        arguments, [(facts | {"collected": collected[name]}, lines) for name, (facts, lines) in summaries.items()]
    )


def _kind(tags: bool) -> type[ExpertCollector]:
    """Return the collector class whose success is determined by AprilTags (extra ``real``) or by the true state."""
    if tags:
        from collectors.sources.tagged_expert import TaggedCollector

        return TaggedCollector
    from collectors.sources.expert import ExpertCollector

    return ExpertCollector
