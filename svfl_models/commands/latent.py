"""The command ``svfl-train latent``, which pretrains one latent model of image, wrench and proprioception."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, natural, positive
from svfl_data.system.printable import say
from svfl_models.commands.options import positive_number
from svfl_models.latent.config import MODELS, PRESETS, LatentConfig

EXAMPLE = """\
svfl-train latent --model poe --data data/block_picking --out out/latent_poe
svfl-train latent --model vtt --data data/block_picking --preset vtt_2022 --contact-n 0.5
svfl-train latent --model poe --data data/block_picking --out out/latent_poe --resume"""
DEFAULT = LatentConfig(data="", model="")


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "latent", help="pretrain a latent model (VTT, PoE or concatenation) on expert episodes", example=EXAMPLE,
        description="Pretrain one latent model; the same command gives the same result, interrupted or not.",
    )  # fmt: skip
    add = parser.add_argument
    add("--model", choices=MODELS, required=True, help="vtt: transformer; poe: product of experts; concat: neither")
    add("--data", type=Path, required=True, help="dataset folder written by svfl-collect expert")
    add("--preset", choices=tuple(PRESETS), default=DEFAULT.preset,
        help="whose sizes and weights (default: %(default)s)")  # fmt: skip
    add("--steps", type=positive, default=DEFAULT.steps, metavar="N", help="of the optimiser (default: %(default)s)")
    add("--batch-size", type=positive, metavar="N", help="sequences per step (default: the preset's)")
    add("--sequence", type=positive, metavar="N", help="actions per sequence (default: the preset's)")
    add("--contact-n", type=positive_number, metavar="F",
        help="force above which a frame counts as contact, N (default: the preset's)")  # fmt: skip
    add("--split", default=DEFAULT.split, metavar="NAME",
        help="stored by svfl-data split (default: 4 of 5 episodes to train on)")  # fmt: skip
    add("--mixed", action="store_true", help="learn from episodes of different tasks or limits of actions together")
    add("--checkpoint-every", type=positive, default=DEFAULT.checkpoint_every, metavar="N",
        help="steps between two checkpoints (default: %(default)s)")  # fmt: skip
    add("--learning-rate", type=positive_number, default=DEFAULT.learning_rate, metavar="R",
        help="default: %(default)s")  # fmt: skip
    add("--seed", type=natural, default=DEFAULT.seed, metavar="S", help="default: %(default)s")
    add("--out", type=Path, metavar="FOLDER", help="default: out/latent_MODEL_PRESET_seedS")
    add("--resume", action="store_true", help="go on from the checkpoint in --out")
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Pretrain one latent model, and print its size, its losses and its files.

    Args:
        arguments: Options of the command.

    Raises:
        SvflError: If the model cannot be trained on the dataset, or a file cannot be read or written.
    """
    options = vars(arguments) | {"data": str(arguments.data)}
    out, resume = options.pop("out"), options.pop("resume")
    del options["command"]
    preset = PRESETS[arguments.preset]
    for name in ("batch_size", "sequence", "contact_n"):
        if options[name] is None:
            options[name] = getattr(preset, name)
    config = LatentConfig(**options)
    if out is None:
        out = Path("out") / f"latent_{config.model}_{config.preset}_seed{config.seed}"

    from svfl_models.latent import train
    from svfl_models.training import run_folder  # torch and lightning take seconds to import

    result = train.train_latent(config, out, resume)
    parts = ", ".join(f"{name} {count:,}" for name, count in result.parameters.items())
    say(f"{sum(result.parameters.values()):,} parameters: {parts}")
    losses = f"loss {result.last['train_loss']:.4g}, on held-out episodes {result.last['valid_loss']:.4g}"
    say(f"{result.steps} steps, {result.seconds:.0f} s; {losses}")
    say(f"checkpoint  {out / run_folder.CHECKPOINT}")
    say(f"metrics     {out / run_folder.METRICS}")
