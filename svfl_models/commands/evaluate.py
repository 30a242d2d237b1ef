"""The command ``svfl-train evaluate``, which measures a policy: its success in an environment, or its errors."""

import argparse
from pathlib import Path

from svfl_data.errors import UsageError
from svfl_data.system.command_line import Commands, add_json, natural, positive, report
from svfl_models.training.run_folder import ACTION_ERRORS, EVALUATION
from svfl_models.training.trackers.names import TRACKERS, check_trackers

EXAMPLE = """\
svfl-train evaluate out/bc_picking/checkpoint.ckpt --episodes 100 --workers 2
svfl-train evaluate out/bc_picking/checkpoint.ckpt --data data/block_picking
svfl-train evaluate out/mine/checkpoint.ckpt --env my_package:my/Wiping-v0 --episodes 50"""
EPISODES = 100


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "evaluate", help="measure how often a trained policy succeeds, or how far its actions are from recorded ones",
        example=EXAMPLE,
        description="Run a policy in the simulation of its task, or in another gymnasium environment, and measure its "
        "success rate. The scenes are in no demonstration; svfl-collect policy with the same seed has the same scenes, "
        "and records the episodes. With --data, no simulation is run; the policy's actions are compared with those "
        "of demonstrations that were not used for its training.",
    )  # fmt: skip
    add = parser.add_argument
    add("checkpoint", type=Path, metavar="CHECKPOINT", help="checkpoint.ckpt of svfl-train bc")
    add("--data", type=Path, metavar="FOLDER",
        help="dataset folder with the successful demonstrations to compare with; in the dataset that the policy was "
        "trained on, only those that were not used (default: run the policy)")  # fmt: skip
    add("--episodes", type=positive, metavar="N",
        help=f"number of episodes to run, or largest number to compare with (default: {EPISODES}, or all of "
        "--data)")  # fmt: skip
    add("--seed", type=natural, metavar="S", help="seed of the scenes, at least 0 (default: 0)")
    add("--robot", metavar="NAME",
        help="robot that acts, a simulated one such as ur5e_sim (default: that of the demonstrations)")  # fmt: skip
    add("--env", metavar="ID",
        help="gymnasium id of the environment, such as my_package:my/Wiping-v0, whose observations have the policy's "
        "inputs by their keys; an episode succeeds by info['success'], or without it by terminating (default: the "
        "simulation of the task)")  # fmt: skip
    add("--workers", type=positive, metavar="N", help="number of episodes that run at the same time (default: 1)")
    add("--out", type=Path, metavar="FILE",
        help=f"file to write, JSON; with --data a report is written beside it (default: {EVALUATION}, or "
        f"{ACTION_ERRORS} with --data, beside the checkpoint)")  # fmt: skip
    add("--logger", nargs="+", choices=TRACKERS, default=[], metavar="NAME",
        help="experiment trackers to log the success rate and a video of the first episode to, in the run of the "
        "training (default: none)")  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Evaluate a policy, write the result as JSON and print it.

    Args:
        arguments: Options of the command.

    Raises:
        UsageError: If options for an environment are given together with a dataset, or a tracker is not installed.
        SvflError: If the checkpoint cannot be used, the environment cannot be run, or the file cannot be written.
    """
    if arguments.data is not None:
        _compare(arguments)
        return
    check_trackers(arguments.logger)
    if arguments.logger and arguments.env:
        raise UsageError("--logger records a video of the simulation, which --env replaces; leave out one of them")
    from svfl_models.cloning.evaluate import evaluate  # torch, lightning and escnn take seconds to import

    found = evaluate(
        arguments.checkpoint, arguments.episodes or EPISODES, arguments.seed or 0, arguments.workers or 1,
        robot=arguments.robot, environment=arguments.env,
    )  # fmt: skip
    found.save(arguments.out or arguments.checkpoint.with_name(EVALUATION))
    if arguments.logger:
        from svfl_models.cloning.evaluation.rollout import log_evaluation

        log_evaluation(found, arguments.logger, arguments.robot)
    report(arguments.json, found.plain(), found)


def _compare(arguments: argparse.Namespace) -> None:
    given = [
        name for name in ("seed", "robot", "env", "workers", "logger") if getattr(arguments, name) not in (None, [])
    ]
    if given:
        raise UsageError(f"--{given[0]} is for running a policy; --data compares with recorded actions")
    from svfl_models.cloning.evaluation.action_errors import action_errors  # torch takes seconds to import

    found = action_errors(arguments.checkpoint, arguments.data, arguments.episodes)
    page = found.save(arguments.out or arguments.checkpoint.with_name(ACTION_ERRORS))
    report(arguments.json, found.plain(), found, f"report  {page}")
