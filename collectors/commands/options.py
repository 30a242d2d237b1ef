"""Options that the commands share: the dataset folder, the workers and their executor, and the world."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from collectors.robots import DEFAULT, is_simulated, make, robots
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Parser, add_json, complete_with, natural, positive, report

if TYPE_CHECKING:  # at run time only when collecting: the command line itself loads no simulation
    from collectors.recording.worker import Executor
    from collectors.simulation.config import WorldConfig


def add_collection(parser: Parser) -> None:
    """Add the options of the dataset and the workers: seed, number of workers, executor, and dataset folder."""
    parser.add_argument(
        "--seed", type=natural, default=0, metavar="S", help="seed of the dataset, at least 0 (default: %(default)s)"
    )
    parser.add_argument(
        "--workers", type=positive, default=1, metavar="N",
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
        help="folder to write the dataset to; a dataset of the same command in it is continued",
    )  # fmt: skip
    add_rerun(parser)
    add_json(parser)


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


CAMERAS = ("front", "top", "side_left", "side_right", "wrist")
"""Names of the simulated cameras, whose module loads the simulation; a test compares."""
SIMULATED = "robot, a simulated one: panda_sim, ur5e_sim, or one that another package adds"
ANY = "robot: panda_sim or ur5e_sim, which are simulated, or one that another package adds, simulated or not"
"""What ``--robot`` takes, in words."""


def add_world(parser: Parser, robot: str = SIMULATED) -> None:
    """Add the options of the simulated world: robot, sensor noise, image size and cameras.

    Args:
        parser: Parser of the command.
        robot: What ``--robot`` takes, in words.
    """
    chosen = parser.add_argument("--robot", default=DEFAULT, metavar="NAME", help=f"{robot} (default: %(default)s)")
    complete_with(chosen, robots)
    parser.add_argument(
        "--sensor-noise", choices=["realistic", "none"], default="realistic",
        help="noise of the simulated wrist force sensor: as of a real sensor, or none (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--image-size", type=positive, default=76, metavar="PX",
        help="height and width of the camera images, px (default: %(default)s)",
    )  # fmt: skip
    cameras = parser.add_argument(
        "--cameras", type=names, default=["front"], metavar="NAME,...",
        help=f"cameras to simulate, with commas between them: {', '.join(CAMERAS)} (default: front)",
    )  # fmt: skip
    cameras.completer = _camera_lists  # type: ignore[attr-defined]  # argcomplete's name


def names(text: str) -> list[str]:
    """Parse names with commas between them; used as an argument type."""
    return text.split(",")


def _camera_lists(prefix: str, **_: object) -> list[str]:
    """Return the lists of cameras that begin with what has been typed, each one camera longer."""
    *done, begun = names(prefix)
    return [",".join([*done, name]) for name in CAMERAS if name.startswith(begun) and name not in done]


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


def tell_datasets(arguments: argparse.Namespace, summaries: Iterable[tuple[dict[str, Any], list[str]]]) -> None:
    """Print what datasets hold, as text or as JSON.

    Args:
        arguments: Parsed options of the command.
        summaries: For each dataset its facts, and lines of text that say the same.
    """
    facts, lines = zip(*summaries, strict=True)
    report(arguments.json, {"datasets": facts}, *(line for some in lines for line in some))
