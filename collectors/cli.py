"""The command ``svfl-collect``."""

import argparse
import functools
import time
from pathlib import Path

from svfl_data.cli import Parser, natural, positive, run

PROGRAM = "svfl-collect"


def main() -> int:
    """Parse the command line and collect; returns the exit code."""
    arguments = build_parser().parse_args()
    return run(functools.partial(arguments.command, arguments), PROGRAM)


def build_parser() -> Parser:
    """The command line of ``svfl-collect``."""
    root = Parser(
        prog=PROGRAM,
        description="Collect visual-force episodes.",
        example="svfl-collect centering --samples 200 --seed 0 --workers 2 --out data/centering",
    )
    tasks = root.add_subparsers(title="tasks", metavar="TASK", required=True, parser_class=Parser)
    centering = tasks.add_parser(
        "centering",
        help="block centering: one finger collides with the block; which way to move?",
        description="Collect block-centering samples in simulation: one finger of an open hand lands on a block, and "
        "the label says which way and how far the hand must move. The same command resumes where it was "
        "stopped; a larger --samples extends the dataset.",
        example="svfl-collect centering --samples 200 --seed 0 --workers 2 --out data/centering\n"
        "svfl-collect centering --samples 1000 --border 0 --noise none --out data/centering_hard",
    )
    centering.add_argument("--samples", type=positive, default=200, metavar="N", help="episodes (default 200)")
    centering.add_argument("--seed", type=natural, default=0, metavar="S", help="seed of the dataset (default 0)")
    centering.add_argument("--workers", type=positive, default=1, metavar="W", help="processes (default 1)")
    centering.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="dataset folder")
    centering.add_argument(
        "--border", type=_border, default=5.0, metavar="DEG",
        help="leave out directions this close to a class border (default 5; 0 is the hard version)",
    )  # fmt: skip
    centering.add_argument("--noise", choices=["realistic", "none"], default="realistic", help="of the wrist sensor")
    centering.add_argument(
        "--image-size", type=positive, default=76, metavar="PX", help="width and height (default 76)"
    )
    centering.set_defaults(command=_centering)
    return root


def _border(text: str) -> float:
    try:
        degrees = float(text)
    except ValueError:
        degrees = -1.0
    if not 0 <= degrees <= 40:
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle between 0 and 40 degrees")
    return degrees


def _centering(arguments: argparse.Namespace) -> None:
    from collectors.centering import TASK, CenteringCollector, summary
    from collectors.dataset import collect_dataset
    from collectors.simulation.camera import CameraConfig
    from collectors.simulation.centering import CenteringConfig
    from collectors.simulation.config import WorldConfig
    from collectors.simulation.noise import NoiseConfig
    from svfl_data.dataset import Dataset

    camera = CameraConfig(height=arguments.image_size, width=arguments.image_size)
    noise = NoiseConfig() if arguments.noise == "realistic" else NoiseConfig.none()
    world = WorldConfig(cameras={"front": camera}, noise=noise)
    collector = CenteringCollector(arguments.seed, CenteringConfig(border_deg=arguments.border), world)
    dataset = Dataset.create_or_resume(arguments.out, TASK, arguments.seed, collector.config())
    start = time.perf_counter()
    done = collect_dataset(dataset, arguments.samples, arguments.workers, collector)
    seconds = time.perf_counter() - start
    if done:
        rate = sum(finished.steps for finished in done) / seconds
        print(f"collected {len(done)} samples in {seconds:.0f} s ({rate:.0f} steps/s)")
    print(summary(dataset))
