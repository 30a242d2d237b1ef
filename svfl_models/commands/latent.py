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
        description="Pretrain one latent model of images, wrenches and proprioception. The same command gives the same "
        "result, also if the training was interrupted and continued with --resume.",
    )  # fmt: skip
    add = parser.add_argument
    add("--model", choices=MODELS, required=True,
        help="kind of latent model: vtt is a transformer, poe a product of experts, concat concatenates "
        "features")  # fmt: skip
    add("--data", type=Path, required=True, help="dataset folder of svfl-collect expert")
    add("--camera", metavar="NAME",
        help="camera whose images are used; must be given if there are several (default: the only camera)")  # fmt: skip
    add("--preset", choices=tuple(PRESETS), default=DEFAULT.preset,
        help="publication whose layer sizes and loss weights are used; balanced are this package's own "
        "(default: %(default)s)")  # fmt: skip
    add("--steps", type=positive, default=DEFAULT.steps, metavar="N",
        help="number of optimiser steps (default: %(default)s)")  # fmt: skip
    add("--batch-size", type=positive, metavar="N",
        help="number of sequences per optimiser step (default: that of the preset)")  # fmt: skip
    add("--sequence", type=positive, metavar="N", help="number of actions per sequence (default: that of the preset)")
    add("--contact-n", type=positive_number, metavar="F",
        help="force above which a frame counts as contact, N, above 0 (default: that of the preset)")  # fmt: skip
    add("--split", default=DEFAULT.split, metavar="NAME",
        help="split that svfl-data split has stored in the dataset (default: a new one with 4 of 5 episodes to train "
        "on)")  # fmt: skip
    add("--mixed", action="store_true",
        help="allow episodes of different tasks, or with different limits of the actions "
        "(default: such datasets are an error)")  # fmt: skip
    add("--checkpoint-every", type=positive, default=DEFAULT.checkpoint_every, metavar="N",
        help="number of optimiser steps between two checkpoints (default: %(default)s)")  # fmt: skip
    add("--learning-rate", type=positive_number, default=DEFAULT.learning_rate, metavar="R",
        help="constant learning rate of Adam, above 0 (default: %(default)s)")  # fmt: skip
    add("--seed", type=natural, default=DEFAULT.seed, metavar="S",
        help="seed of everything random in the training, at least 0 (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, metavar="FOLDER",
        help="folder to write the run to (default: out/latent_MODEL_PRESET_seedS)")  # fmt: skip
    add("--resume", action="store_true",
        help="continue from the checkpoint in the folder of --out "
        "(default: start anew; an existing checkpoint is an error)")  # fmt: skip
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
    say(f"report      {out / run_folder.REPORT}")
    say(f"metrics     {out / run_folder.METRICS}")
