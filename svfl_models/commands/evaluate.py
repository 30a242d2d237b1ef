"""The command ``svfl-train evaluate``, which measures how often a trained policy succeeds in simulation."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, add_json, natural, positive, report
from svfl_models.training.run_folder import EVALUATION

EXAMPLE = "svfl-train evaluate out/bc_picking/checkpoint.ckpt --episodes 100 --workers 2"


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "evaluate", help="measure how often a trained policy succeeds in simulation", example=EXAMPLE,
        description="Run a policy in the simulation of its task and measure its success rate. The scenes are in no "
        "demonstration; svfl-collect policy with the same seed has the same scenes, and records the episodes.",
    )  # fmt: skip
    add = parser.add_argument
    add("checkpoint", type=Path, metavar="CHECKPOINT", help="checkpoint.ckpt of svfl-train bc")
    add("--episodes", type=positive, default=100, metavar="N",
        help="number of episodes to run (default: %(default)s)")  # fmt: skip
    add("--seed", type=natural, default=0, metavar="S", help="seed of the scenes, at least 0 (default: %(default)s)")
    add("--robot", metavar="NAME",
        help="robot that acts, a simulated one such as ur5e_sim (default: that of the demonstrations)")  # fmt: skip
    add("--workers", type=positive, default=1, metavar="N",
        help="number of episodes that run at the same time (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, metavar="FILE",
        help=f"file to write, the result as JSON (default: {EVALUATION} beside the checkpoint)")  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Evaluate a policy, write the result as JSON and print it.

    Args:
        arguments: Options of the command.

    Raises:
        SvflError: If the checkpoint cannot be used, the environment cannot be run, or the file cannot be written.
    """
    from svfl_models.cloning.evaluate import evaluate  # torch, lightning and escnn take seconds to import

    found = evaluate(arguments.checkpoint, arguments.episodes, arguments.seed, arguments.workers, robot=arguments.robot)
    found.save(arguments.out or arguments.checkpoint.with_name(EVALUATION))
    report(arguments.json, found.plain(), found)
