"""Options that the commands share: the dataset folder, the workers and their executor, and the world."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from collectors.robots import DEFAULT, is_simulated, make
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Parser, natural, positive

if TYPE_CHECKING:  # at run time only when collecting: the command line itself loads no simulation
    from collectors.recording.worker import Executor
    from collectors.simulation.config import WorldConfig


def add_collection(parser: Parser) -> None:
    """Add the options of the dataset and the workers: seed, number of workers, executor, and dataset folder."""
    parser.add_argument(
        "--seed", type=natural, default=0, metavar="S", help="seed of the dataset, at least 0 (default: %(default)s)"
    )
    parser.add_argument(
        "--workers", type=positive, default=1, metavar="W",
        help="number of episodes that are recorded at the same time, each in its own process (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--executor", choices=["processes", "ray"], default="processes",
        help="where the workers run: in processes of this machine, or on a Ray cluster (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--address", metavar="HOST:PORT",
        help="with --executor ray: address of the Ray cluster (default: a cluster on this machine)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER",
        help="dataset folder to write; a dataset of the same command in it is continued",
    )  # fmt: skip
    add_rerun(parser)


def add_rerun(parser: Parser) -> None:
    """Add the option that shows episodes in a viewer while they are recorded."""
    parser.add_argument(
        "--rerun", nargs="?", const="127.0.0.1:9876", metavar="HOST:PORT",
        help="show the episodes while they are recorded, on the running viewer at this address, or at %(const)s if "
        "none is given; start a viewer with: rerun (default: not shown)",
    )  # fmt: skip


def executor(arguments: argparse.Namespace) -> Executor:
    """Return the executor that the options ask for.

    Args:
        arguments: Parsed options of `add_collection`.

    Raises:
        UsageError: If an address is given for another executor than Ray.
    """
    if arguments.executor == "ray":
        from collectors.recording.ray import Ray

        return Ray(arguments.address)
    if arguments.address:
        raise UsageError(f"--address {arguments.address} is for --executor ray")
    from collectors.recording.processes import run

    return run


SIMULATED = "simulated robot: panda_sim, ur5e_sim, or one that another package adds"
ANY = "robot: panda_sim or ur5e_sim, which are simulated, or one that another package adds, simulated or not"
"""What ``--robot`` takes, in words."""


def add_world(parser: Parser, robot: str = SIMULATED) -> None:
    """Add the options of the simulated world: robot, sensor noise, image size and cameras.

    Args:
        parser: Parser of the command.
        robot: What ``--robot`` takes, in words.
    """
    parser.add_argument("--robot", default=DEFAULT, metavar="NAME", help=f"{robot} (default: %(default)s)")
    parser.add_argument(
        "--sensor-noise", choices=["realistic", "none"], default="realistic",
        help="noise of the simulated wrist force sensor: as of a real sensor, or none (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--image-size", type=positive, default=76, metavar="PX",
        help="width and height of the camera images, px (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--cameras", type=lambda text: text.split(","), default=["front"], metavar="NAME,...",
        help="cameras to simulate, with commas between them: front, top, side_left, side_right, wrist (default: front)",
    )  # fmt: skip


def world(arguments: argparse.Namespace) -> WorldConfig:
    """Return the configuration of the world that the options ask for.

    Args:
        arguments: Parsed options of `add_world`.

    Raises:
        UsageError: If no robot or camera has one of the names.
    """
    from dataclasses import replace

    from collectors.simulation.camera import cameras_named
    from collectors.simulation.config import WorldConfig
    from collectors.simulation.noise import NoiseConfig

    cameras = cameras_named(arguments.cameras)
    size = arguments.image_size
    return WorldConfig(
        robot=make(arguments.robot),
        noise=NoiseConfig() if arguments.sensor_noise == "realistic" else NoiseConfig.none(),
        cameras={name: replace(camera, height=size, width=size) for name, camera in cameras.items()},
    )


def real_robot(arguments: argparse.Namespace) -> str | None:
    """Return the name of the robot if it is not a simulated one, and None otherwise.

    Args:
        arguments: Parsed options of `add_world`.

    Raises:
        UsageError: If no robot has the name, or an option of the simulation is given for a robot that is not simulated.
    """
    if is_simulated(arguments.robot):
        return None
    parser = Parser()
    add_world(parser)
    for name, default in vars(parser.parse_args([])).items():
        if name != "robot" and getattr(arguments, name) != default:
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} is for simulated robots, and robot {arguments.robot} is not simulated")
    return str(arguments.robot)


def between(low: float, high: float, what: str) -> Callable[[str], float]:
    """Return an argument type that accepts a number in a range.

    Args:
        low: Smallest number that is accepted.
        high: Largest number that is accepted.
        what: Name of the quantity for the error message, such as ``an angle in degrees``.

    Returns:
        Function for argparse that turns a text into a number.
    """

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not {what} between {low:g} and {high:g}")
        return value

    return parse
