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
svfl-train bc --data data/mine --group C4 --inputs cameras/front streams/wrench/wrench=64@500 observations/tcp_velocity
svfl-train evaluate out/bc_picking/checkpoint.ckpt --episodes 100 --workers 2"""
DEFAULT = CloningConfig(data="")


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "bc", help="train a policy to imitate demonstrations (behaviour cloning)", example=EXAMPLE,
        description="Train the policy network of the paper (Kohler et al., CoRL 2023) on demonstrations by behaviour "
        "cloning. The same command gives the same policy. After an interruption, the same command continues after the "
        "last complete epoch.",
    )  # fmt: skip
    add = parser.add_argument
    add("--data", type=Path, required=True, help="dataset folder with demonstrations, as of svfl-collect expert")
    add("--episodes", type=positive, default=DEFAULT.episodes, metavar="N",
        help="number of demonstrations to use: the first ones that succeeded; one tenth of them is held out for "
        "validation (default: %(default)s)")  # fmt: skip
    add("--encoder", choices=ENCODERS, default=DEFAULT.encoder,
        help="inputs of the network: v for image, f for wrench (force and torque), p for proprioception, or several of "
        "them (default: %(default)s)")  # fmt: skip
    add("--inputs", nargs="+", default=[], metavar="INPUT",
        help="inputs of your own in the place of --encoder: cameras (cameras/front), windows of streams with number "
        "of readings and rate (streams/wrench/wrench=64@500), arrays below observations/; :invariant at the end "
        "for a sensor or camera on the gripper that does not turn with the world; images are cropped to their "
        "middle (default: none)")  # fmt: skip
    add("--action", default=DEFAULT.action, metavar="PATH",
        help="array with the actions to learn, if --inputs are given (default: %(default)s)")  # fmt: skip
    add("--model", choices=MODELS,
        help="kind of network: svfl is symmetric; cnn is the baseline without symmetry that has about as many "
        "parameters, the same as --group none (default: svfl)")  # fmt: skip
    add("--group", choices=tuple(GROUPS),
        help="symmetry group of the network: C for rotations, D for rotations and reflections, and the number of "
        f"rotations; none for no symmetry (default: {DEFAULT.group}, or none with --model cnn)")  # fmt: skip
    add("--seed", type=natural, default=DEFAULT.seed, metavar="S",
        help="seed of the training and of the choice of held-out episodes, at least 0 "
        "(default: %(default)s)")  # fmt: skip
    add("--preset", choices=tuple(PRESETS), default=DEFAULT.preset,
        help="sizes of the network's layers (default: %(default)s)")  # fmt: skip
    add("--loss", choices=LOSSES, default=DEFAULT.loss,
        help="loss: action is the error of the action; likelihood is the negative log-likelihood, with which the "
        "standard deviations of the actions are learned too (default: %(default)s)")  # fmt: skip
    add("--plain-images", dest="augment", action="store_false",
        help="change training images only by the random crops of the paper (default: colours and depth are changed at "
        "random too, and crops are shifted further)")  # fmt: skip
    add("--rotate", action="store_true",
        help="rotate training steps, observations and actions together, by random quarter turns and mirror them at "
        "random (default: not)")  # fmt: skip
    add("--view", choices=VIEWS, default=DEFAULT.view,
        help="centre of the network's images: the gripper, or the middle of the camera image "
        "(default: %(default)s)")  # fmt: skip
    add("--image-size", type=int, choices=IMAGE_SIZES, default=DEFAULT.image_size,
        help="height and width of the network's images, px (default: %(default)s)")  # fmt: skip
    add(
        "--camera", metavar="NAME", help="camera whose images are used (default: the only camera of the demonstrations)"
    )
    add("--epochs", type=positive, default=DEFAULT.epochs, metavar="N",
        help="number of epochs to train (default: %(default)s)")  # fmt: skip
    add("--batch-size", type=positive, default=DEFAULT.batch_size, metavar="N",
        help="number of demonstrated steps per optimiser step (default: %(default)s)")  # fmt: skip
    add("--learning-rate", type=positive_number, default=DEFAULT.learning_rate, metavar="R",
        help="learning rate of Adam at the start of the training, above 0 (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, metavar="FOLDER",
        help="folder to write the run to (default: out/bc_DATA_ENCODER_GROUP_N_seedS)")  # fmt: skip
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
        seen = "own" if config.inputs else config.encoder
        name = f"bc_{arguments.data.name}_{seen}_{config.group}_{config.episodes}_seed{config.seed}"
        out = Path("out") / name

    from svfl_models.cloning import train
    from svfl_models.training import run_folder  # torch, lightning and escnn take seconds to import

    result = train.train_cloning(config, out)
    (learned, held_out), (steps, _) = result.episodes, result.steps
    say(f"learned {steps} steps of {learned} episodes of {config.data}; on {held_out} held-out ones:")
    gripper = "" if result.valid_gripper is None else f"gripper wrong in {result.valid_gripper:.1%}, "
    if result.valid_xy_mm is None:
        say(f"{gripper}action {result.valid_error:.1%} of its bounds off")
    else:
        say(
            f"{gripper}(dx, dy) {result.valid_xy_mm:.1f} mm off, dz {result.valid_z_mm:.1f} mm, "
            f"dtheta {result.valid_turn_deg:.1f} deg"
        )
    say(f"{result.parameters:,} parameters, {result.epochs} epochs, {result.seconds:.0f} s of training")
    say(f"checkpoint  {out / run_folder.CHECKPOINT}")
    say(f"report      {out / run_folder.REPORT}")
    way = "export" if config.inputs else "evaluate"
    say(f"try it      svfl-train {way} {out / run_folder.CHECKPOINT}{' --out policy.pt2' if config.inputs else ''}")
