"""The command ``svfl-train check``, which measures how symmetric a trained network is on real episodes."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from svfl_data.system.command_line import Commands, add_json, positive, report
from svfl_data.system.command_line.report import as_json
from svfl_models.symmetry.groups import GROUPS

if TYPE_CHECKING:
    from svfl_models.centering.check import ElementCheck

EXAMPLE = """\
svfl-train check out/centering/checkpoint.ckpt --data data/centering
svfl-train check out/centering/checkpoint.ckpt --data data/centering --group D8 --precision bf16"""
EPISODES = 100
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
    add("checkpoint", type=Path, metavar="CHECKPOINT", help="checkpoint.ckpt of svfl-train centering")
    add("--data", type=Path, required=True, metavar="FOLDER", help="dataset folder of svfl-collect centering")
    add("--group", choices=tuple(name for name in GROUPS if name != "none"),
        help="symmetry group to test (default: the network's own group, or D4 for a network "
        "without symmetry)")  # fmt: skip
    add("--episodes", type=positive, default=EPISODES, metavar="N",
        help="number of episodes to use: the first ones of the dataset (default: %(default)s)")  # fmt: skip
    add("--precision", choices=PRECISIONS, default=PRECISIONS[0],
        help="number format of the arithmetic: 32 or 64 bit floats, or bf16 (default: %(default)s)")  # fmt: skip
    add_json(parser)
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

    from svfl_models.centering import (
        check,  # torch, lightning and escnn take seconds to import
        checkpoint,  # torch, lightning and escnn take seconds to import
        compatibility,  # torch, lightning and escnn take seconds to import
        train,  # torch, lightning and escnn take seconds to import
    )

    module = checkpoint.load_classifier(arguments.checkpoint)
    config = checkpoint.configuration(module, arguments.data)
    samples = train.samples_of(arguments.data, config)
    samples = samples.take(np.arange(min(arguments.episodes, len(samples))))
    normalization = module.classifier.trunk.normalization
    compatibility.expect_fit(normalization, samples, config.encoder, arguments.checkpoint, arguments.data)
    group = GROUPS[arguments.group] if arguments.group else None
    rows = check.check(module, samples, config, group, arguments.precision)

    facts = {"checkpoint": arguments.checkpoint, "data": arguments.data, "group": config.group}
    facts |= {"precision": arguments.precision, "episodes": len(samples)}
    facts |= {"elements": [{"name": row.name, **as_json(row)} for row in rows]}
    head = f"{arguments.checkpoint}: group {config.group}, {len(samples)} episodes of {arguments.data}"
    report(arguments.json, facts, head, *_table(rows))
    check.expect_symmetric(rows, arguments.precision, arguments.checkpoint)


def _table(rows: "Sequence[ElementCheck]") -> list[str]:
    """Return a heading and a line for each group element, in columns."""
    cells: list[tuple[str, ...]] = [("element", "expected", "output error", "hidden error", "accuracy")]
    for row in rows:
        errors = ("-" if error is None else f"{error:.1e}" for error in (row.output_error, row.hidden_error))
        cells.append((row.name, row.expected, *errors, f"{row.accuracy:.1%}"))
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    words, numbers = slice(2), slice(2, None)
    return [
        "  ".join(
            [f"{cell:<{width}}" for cell, width in zip(line[words], widths[words], strict=True)]
            + [f"{cell:>{width}}" for cell, width in zip(line[numbers], widths[numbers], strict=True)]
        )
        for line in cells
    ]
