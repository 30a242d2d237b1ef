"""The command ``svfl-train bc``, which trains a policy on demonstrations by behaviour cloning."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, natural, positive
from svfl_data.system.printable import say
from svfl_models.centering.config import MODELS
from svfl_models.cloning.config import ENCODERS, LOSSES, VIEWS, CloningConfig
from svfl_models.commands.options import group_of, positive_number
from svfl_models.networks.inputs import IMAGE_SIZES
from svfl_models.networks.presets import PRESETS
from svfl_models.symmetry.groups import GROUPS

EXAMPLE = """\
svfl-train bc --data data/block_picking --model svfl --encoder vfp --episodes 50 --seed 0 --out out/bc_picking
svfl-train bc --data data/block_picking --model cnn --encoder vp --episodes 20
svfl-train evaluate out/bc_picking/checkpoint.ckpt --episodes 100 --workers 2"""
DEFAULT = CloningConfig(data="")


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "bc", help="behaviour cloning: a policy that does what demonstrations do", example=EXAMPLE,
        description="Train the paper's actor on demonstrations. The same command gives the same policy; one that was "
        "interrupted goes on after its last whole epoch.",
    )  # fmt: skip
    add = parser.add_argument
    add("--data", type=Path, required=True, help="dataset folder, such as one written by svfl-collect expert")
    add("--episodes", type=positive, default=DEFAULT.episodes, metavar="N",
        help="successful episodes to use; a tenth is held out (default: %(default)s)")  # fmt: skip
    add("--encoder", choices=ENCODERS, default=DEFAULT.encoder,
        help="image, force, proprioception, or several (default: %(default)s)")  # fmt: skip
    add(
        "--model",
        choices=MODELS,
        help="svfl: symmetric (default); cnn: the baseline with as many parameters, as --group none",
    )
    add("--group", choices=tuple(GROUPS), help=f"symmetry of the network (default: {DEFAULT.group})")
    add("--seed", type=natural, default=DEFAULT.seed, metavar="S", help="default: %(default)s")
    add("--preset", choices=tuple(PRESETS), default=DEFAULT.preset, help="size of the network (default: %(default)s)")
    add("--loss", choices=LOSSES, default=DEFAULT.loss,
        help="action: error of the action; likelihood: learns deviations too (default: %(default)s)")  # fmt: skip
    add("--plain-images", dest="augment", action="store_false",
        help="only the paper's crops: no random colours, no larger shifts")  # fmt: skip
    add("--view", choices=VIEWS, default=DEFAULT.view,
        help="middle of the picture: the gripper, or the camera's own (default: %(default)s)")  # fmt: skip
    add("--image-size", type=int, choices=IMAGE_SIZES, default=DEFAULT.image_size, help="[px] (default: %(default)s)")
    add("--camera", metavar="NAME", help="whose images to use (default: the first one's)")
    add("--epochs", type=positive, default=DEFAULT.epochs, metavar="N", help="default: %(default)s")
    add("--batch-size", type=positive, default=DEFAULT.batch_size, metavar="N", help="default: %(default)s")
    add("--learning-rate", type=positive_number, default=DEFAULT.learning_rate, metavar="R",
        help="default: %(default)s")  # fmt: skip
    add("--out", type=Path, metavar="FOLDER", help="default: out/bc_DATA_ENCODER_GROUP_N_seedS")
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Train one policy and print its errors on the held-out episodes.

    Args:
        arguments: Options of the command.

    Raises:
        SvflError: If the policy cannot be trained on the dataset, or a file cannot be written.
    """
    options = vars(arguments) | {"data": str(arguments.data), "group": group_of(arguments)}
    out = options.pop("out")
    del options["command"], options["model"]
    config = CloningConfig(**options)
    if out is None:
        name = f"bc_{arguments.data.name}_{config.encoder}_{config.group}_{config.episodes}_seed{config.seed}"
        out = Path("out") / name

    from svfl_models.cloning import train
    from svfl_models.training import run_folder  # torch, lightning and escnn take seconds to import

    result = train.train_cloning(config, out)
    (learned, held_out), (steps, _) = result.episodes, result.steps
    say(f"learned {steps} steps of {learned} episodes of {config.data}; on {held_out} held-out ones:")
    say(
        f"gripper wrong in {result.valid_gripper:.1%}, (dx, dy) {result.valid_xy_mm:.1f} mm off, "
        f"dz {result.valid_z_mm:.1f} mm, dtheta {result.valid_turn_deg:.1f} deg"
    )
    say(f"{result.parameters:,} parameters, {result.epochs} epochs, {result.seconds:.0f} s of training")
    say(f"checkpoint  {out / run_folder.CHECKPOINT}")
    say(f"try it      svfl-train evaluate {out / run_folder.CHECKPOINT}")
