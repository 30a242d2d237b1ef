"""The command ``svfl-train latent-eval``, which evaluates a pretrained latent model on held-out episodes."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, add_json, natural, positive
from svfl_data.system.command_line import report as tell
from svfl_data.system.progress import progress_console

EXAMPLE = """\
svfl-train latent-eval out/latent_poe/checkpoint.ckpt
svfl-train latent-eval out/latent_vtt/checkpoint.ckpt --episodes 10 --out out/vtt_quick"""
FOLDER = "latent_eval"
EPISODES = 40


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "latent-eval", help="evaluate a pretrained latent model on held-out episodes", example=EXAMPLE,
        description="Evaluate a pretrained latent model on episodes that it was not trained on: reconstruction, "
        "contact, alignment, prediction, linear probes, missing modalities, the weight of each expert, and symmetry.",
    )  # fmt: skip
    add = parser.add_argument
    add("checkpoint", type=Path, metavar="CHECKPOINT", help="checkpoint.ckpt of svfl-train latent")
    add("--data", type=Path, metavar="FOLDER",
        help="dataset folder to evaluate on: another dataset, or the new place of the training's one (default: the "
        "folder that the checkpoint names)")  # fmt: skip
    add("--episodes", type=positive, default=EPISODES, metavar="N",
        help="number of episodes to evaluate, at most; if there are more, they are drawn at random "
        "(default: %(default)s)")  # fmt: skip
    add("--seed", type=natural, default=0, metavar="S",
        help="seed of everything that is drawn at random, at least 0 (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, metavar="FOLDER",
        help=f"folder to write the report to (default: {FOLDER} beside the checkpoint)")  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Evaluate a latent model, write the report and print its main numbers.

    Args:
        arguments: Options of the command.

    Raises:
        SvflError: If the checkpoint or the dataset cannot be used, or a file cannot be written.
    """
    from svfl_models.latent.checkpoint import read_latent
    from svfl_models.latent.evaluation.evaluate import evaluate
    from svfl_models.latent.evaluation.pages import report  # torch and lightning take seconds to import
    from svfl_models.latent.evaluation.pages.tables import compact

    out = arguments.out or arguments.checkpoint.with_name(FOLDER)
    read_latent(arguments.checkpoint)  # no folder is made if the file is not a checkpoint
    report.prepare(out)
    with progress_console().status("loading") as status:  # silent where there is no terminal
        found, samples = evaluate(
            arguments.checkpoint, arguments.data, arguments.episodes, arguments.seed, lambda stage: status.update(stage)
        )
    files = report.write(out, found, samples)
    lines = [f"{found.model} after {found.steps} steps, on {found.episodes} {found.of}"]
    rows = compact(found)
    width = max(len(name) for name, _ in rows) + 2
    lines += [f"{name:<{width}}{words}" for name, words in rows]
    lines += [f"not evaluated: {line}" for line in found.left_out]
    tell(arguments.json, found.plain() | {"files": files}, *lines, f"report  {files[0]}")
