"""The command ``svfl-train check``, which measures how symmetric a trained network is on real episodes."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, positive
from svfl_data.system.printable import say
from svfl_models.symmetry.groups import GROUPS

EXAMPLE = """\
svfl-train check out/centering/checkpoint.ckpt --data data/centering
svfl-train check out/centering/checkpoint.ckpt --data data/centering --group D8 --precision bf16"""
SAMPLES = 100
PRECISIONS = ("32", "64", "bf16")


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "check", help="measure how symmetric a trained network is on recorded episodes", example=EXAMPLE,
        description="Rotate and mirror recorded episodes, and compare the outputs of a block-centering network with "
        "those that its symmetry requires. The exit code is 1 if the outputs of a symmetric network differ by more "
        "than rounding errors at quarter turns and flips, which map pixels onto pixels.",
    )  # fmt: skip
    add = parser.add_argument
    add("checkpoint", type=Path, help="checkpoint.ckpt of svfl-train centering")
    add("--data", type=Path, required=True, help="dataset folder of svfl-collect centering")
    add("--group", choices=tuple(name for name in GROUPS if name != "none"),
        help="group of the rotations and reflections to test (default: the network's own group, or D4 for a network "
        "without symmetry)")  # fmt: skip
    add("--samples", type=positive, default=SAMPLES, metavar="N",
        help="number of episodes to use: the first ones of the dataset (default: %(default)s)")  # fmt: skip
    add("--precision", choices=PRECISIONS, default=PRECISIONS[0],
        help="number format of the arithmetic: 32 or 64 bit floats, or bf16 (default: %(default)s)")  # fmt: skip
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Measure how symmetric a network is, and print a table with a row per group element.

    Args:
        arguments: Options of the command.

    Raises:
        TrainingError: If a symmetric network errs by more than rounding where pixels move onto pixels.
        SvflError: If the checkpoint or the dataset cannot be used.
    """
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from svfl_models.centering import (
        check,  # torch, lightning and escnn take seconds to import
        checkpoint,  # torch, lightning and escnn take seconds to import
        compatibility,  # torch, lightning and escnn take seconds to import
        train,  # torch, lightning and escnn take seconds to import
    )

    module = checkpoint.load_classifier(arguments.checkpoint)
    config = checkpoint.configuration(module, arguments.data)
    samples = train.samples_of(arguments.data, config)
    samples = samples.take(np.arange(min(arguments.samples, len(samples))))
    normalization = module.classifier.trunk.normalization
    compatibility.expect_fit(normalization, samples, config.encoder, arguments.checkpoint, arguments.data)
    group = GROUPS[arguments.group] if arguments.group else None
    rows = check.check(module, samples, config, group, arguments.precision)

    say(f"{arguments.checkpoint}: group {config.group}, {len(samples)} episodes of {arguments.data}")
    table = Table()
    for heading in ("element", "expected", "output error", "hidden error", "accuracy"):
        table.add_column(heading, justify="left" if heading in ("element", "expected") else "right", no_wrap=True)
    for row in rows:
        errors = ("-" if error is None else f"{error:.1e}" for error in (row.output_error, row.hidden_error))
        table.add_row(row.name, row.expected, *errors, f"{row.accuracy:.1%}")
    Console().print(table)
    check.expect_symmetric(rows, arguments.precision, arguments.checkpoint)
