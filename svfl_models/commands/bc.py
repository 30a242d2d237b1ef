"""The command ``svfl-train bc``, which trains a policy on demonstrations by behaviour cloning."""

import argparse
from pathlib import Path
from typing import Any

from svfl_data.system.command_line import Commands
from svfl_data.system.printable import say
from svfl_models.cloning.config import CloningConfig
from svfl_models.commands.options import add_model, add_out, with_model
from svfl_models.configuration.program import Program
from svfl_models.configuration.resolving import build
from svfl_models.configuration.setting import settings_of
from svfl_models.training.run_settings import RunSettings

EXAMPLE = """\
svfl-train bc --data data/block_picking --model svfl --encoder vfp --episodes 50 --seed 0 --out out/bc_picking
svfl-train bc --data data/block_picking --model cnn --encoder vp --episodes 20
svfl-train bc --data data/mine --group C4 --inputs cameras/front streams/wrench/wrench=64@500 observations/tcp_velocity
svfl-train bc --config run.yaml --set widths.latent=12 --learning-rate 3e-4
svfl-train evaluate out/bc_picking/checkpoint.ckpt --episodes 100 --workers 2"""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = PROGRAM.add(commands)
    add_model(parser)
    add_out(parser, "out/bc_DATA_ENCODER_GROUP_N_seedS")


def run(values: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Train one policy and print its errors on the held-out episodes.

    Args:
        values: Value of each setting.
        arguments: Other options of the command.

    Raises:
        SvflError: If the policy cannot be trained on the dataset, or a file cannot be written.
    """
    config, out = build(CloningConfig, values), arguments.out
    if out is None:
        seen = "own" if config.inputs else config.encoder
        name = f"bc_{Path(config.data).name}_{seen}_{config.group}_{config.episodes}_seed{config.seed}"
        out = Path("out") / name

    from svfl_models.cloning import train
    from svfl_models.training import run_folder  # torch, lightning and escnn take seconds to import

    given = build(RunSettings, values)
    result = train.train_cloning(config, out, hardware=given.hardware, loggers=given.logger)
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


PROGRAM = Program(
    "bc",
    help="train a policy to imitate demonstrations (behaviour cloning)",
    description="Train the policy network of the paper (Kohler et al., CoRL 2023) on demonstrations by behaviour "
    "cloning. The same command gives the same policy. After an interruption, the same command continues after the "
    "last complete epoch.",
    example=EXAMPLE,
    settings=(*settings_of(CloningConfig), *settings_of(RunSettings)),
    run=run,
    prepare=with_model,
)
