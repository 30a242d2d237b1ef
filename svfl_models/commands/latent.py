"""The command ``svfl-train latent``, which pretrains one latent model of image, wrench and proprioception."""

import argparse
from pathlib import Path
from typing import Any

from svfl_data.system.command_line import Commands
from svfl_data.system.printable import say
from svfl_models.commands.options import add_out
from svfl_models.configuration.program import Program
from svfl_models.configuration.resolving import build
from svfl_models.configuration.setting import settings_of
from svfl_models.latent.config import LatentConfig
from svfl_models.training.run_settings import RunSettings

EXAMPLE = """\
svfl-train latent --model poe --data data/block_picking --out out/latent_poe
svfl-train latent --model vtt --data data/block_picking --preset vtt_2022 --contact-n 0.5
svfl-train latent --model poe --data data/block_picking --set weights.contact=100 --set sizes.feature=128"""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = PROGRAM.add(commands)
    add_out(parser, "out/latent_MODEL_PRESET_seedS")


def with_preset(given: dict[str, Any], _: argparse.Namespace) -> dict[str, Any]:
    """Return the given settings with those that follow from the preset."""
    preset = given.get("preset", LatentConfig.preset)
    return LatentConfig.of_preset(preset) | given


def run(values: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Pretrain one latent model, and print its size, its losses and its files.

    Args:
        values: Value of each setting.
        arguments: Other options of the command.

    Raises:
        SvflError: If the model cannot be trained on the dataset, or a file cannot be read or written.
    """
    config = build(LatentConfig, values)
    out = arguments.out or Path("out") / f"latent_{config.model}_{config.preset}_seed{config.seed}"

    from svfl_models.latent import train
    from svfl_models.training import run_folder  # torch and lightning take seconds to import

    given = build(RunSettings, values)
    result = train.train_latent(config, out, hardware=given.hardware, loggers=given.logger)
    parts = ", ".join(f"{name} {count:,}" for name, count in result.parameters.items())
    say(f"{sum(result.parameters.values()):,} parameters: {parts}")
    losses = f"loss {result.last['train_loss']:.4g}, on held-out episodes {result.last['valid_loss']:.4g}"
    say(f"{result.steps} steps, {result.seconds:.0f} s; {losses}")
    say(f"checkpoint  {out / run_folder.CHECKPOINT}")
    say(f"report      {out / run_folder.REPORT}")
    say(f"metrics     {out / run_folder.METRICS}")


PROGRAM = Program(
    "latent",
    help="pretrain a latent model (VTT, PoE or concatenation) on expert episodes",
    description="Pretrain one latent model of images, wrenches and proprioception. The same command gives the same "
    "result. After an interruption, and with more --steps at a constant learning rate, the same command continues "
    "after the last checkpoint.",
    example=EXAMPLE,
    settings=(*settings_of(LatentConfig), *settings_of(RunSettings)),
    run=run,
    prepare=with_preset,
)
