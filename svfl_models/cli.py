"""The ``svfl-train`` command."""

import math
import sys
from argparse import ArgumentTypeError
from pathlib import Path

from svfl_data.cli import Parser, natural, positive, run
from svfl_data.errors import TrainingError
from svfl_models.config import ENCODERS, MODELS, TORQUES, TrainingConfig
from svfl_models.presets import PRESETS

PROGRAM = "svfl-train"
EXAMPLE = """\
svfl-train centering --data data/centering --encoder vf --model svfl --train-samples 100 --seed 0 --out out/centering
svfl-train centering --data data/centering --encoder f --model cnn --train-samples 10"""


def positive_number(text: str) -> float:
    """Argument type: a finite number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < math.inf:
        raise ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def build_parser() -> Parser:
    """Arguments of the command."""
    default = TrainingConfig(data="")
    parser = Parser(prog=PROGRAM, description="Train symmetric visual-force networks.", example=EXAMPLE)
    centering = parser.add_subparsers(dest="task", required=True, metavar="TASK").add_parser(
        "centering", help="classify the direction that centres the hand over the block", example=EXAMPLE
    )
    add = centering.add_argument
    add("--data", type=Path, required=True, help="dataset folder written by svfl-collect centering")
    add("--encoder", choices=ENCODERS, default=default.encoder, help="image, force, or both (default: %(default)s)")
    add("--model", choices=MODELS, default=default.model, help="symmetric, or its plain twin (default: %(default)s)")
    add("--train-samples", type=positive, default=default.train_samples, metavar="N", help="default: %(default)s")
    add("--test-samples", type=positive, default=default.test_samples, metavar="N", help="default: %(default)s")
    add("--seed", type=natural, default=default.seed, metavar="S", help="default: %(default)s")
    add("--preset", choices=tuple(PRESETS), default=default.preset, help="size of the network (default: %(default)s)")
    add("--torque", choices=TORQUES, default=default.torque, help="how a torque transforms (default: %(default)s)")
    add("--epochs", type=positive, default=default.epochs, metavar="N", help="at most (default: %(default)s)")
    add(
        "--learning-rate", type=positive_number, default=default.learning_rate, metavar="R", help="default: %(default)s"
    )
    add("--out", type=Path, help="output folder (default: out/centering_ENCODER_MODEL_N_seedS)")
    return parser


def main(arguments: list[str] | None = None) -> None:
    """Parse, train, print where everything is, and exit with the command's code."""
    options = vars(build_parser().parse_args(arguments))
    options.pop("task")
    out = options.pop("out")
    config = TrainingConfig(**options | {"data": str(options["data"])})
    if out is None:
        out = Path("out") / f"centering_{config.encoder}_{config.model}_{config.train_samples}_seed{config.seed}"
    sys.exit(run(lambda: centering(config, out), PROGRAM))


def centering(config: TrainingConfig, out: Path) -> None:
    """Train one classifier and print its result beside the paper's."""
    try:
        from svfl_models import paper, report, run_folder, train  # torch, lightning and escnn take seconds to import
    except ImportError as error:
        raise TrainingError(f"training needs a package that is missing here: {error}") from error
    result = train.train_centering(config, out)
    figure = paper.centering_words(config.encoder, config.model, config.train_samples)
    print(f"{report.cell_name(config)}: test accuracy {result.test_accuracy:.1%} (paper: {figure})")
    print(f"{result.parameters:,} parameters, {result.epochs} epochs, {result.seconds:.0f} s of training")
    print(f"data        {config.data}")
    print(f"checkpoint  {out / run_folder.CHECKPOINT}")
    print(f"report      {out / run_folder.REPORT}")
