"""The command ``svfl-train info``, which prints the description in the file of a trained network."""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svfl_data.system.command_line import Commands, add_json, report
from svfl_data.system.printable import printable

if TYPE_CHECKING:
    from svfl_models.deployment.inspection import Inspection

EXAMPLE = """\
svfl-train info out/bc_picking/checkpoint.ckpt
svfl-train info out/bc_picking
svfl-train info policy.pt2 --json
svfl-train info out/centering/classifier.onnx"""
EXPORTED = (".pt2", ".onnx")
LONGEST_SAID = 200
"""Most characters of a value that are printed."""
MOST_NAMED = 60
"""Most entries of a mapping that are printed."""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "info", help="print how a network was trained: configuration, inputs, sizes, data, provenance", example=EXAMPLE,
        description="Print the description in the file of a trained network: the program that wrote it, its "
        "configuration, inputs and cameras, group, sizes and number of parameters, the data with their identity as "
        "svfl-data info prints it, the commit, versions, machines and commands of its training, and the results in the "
        "same folder.",
    )  # fmt: skip
    parser.add_argument(
        "network", type=Path, metavar="NETWORK",
        help="checkpoint.ckpt of svfl-train, a file of svfl-train export (.pt2 or .onnx), or the folder of a training",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Print the facts, as text or as JSON.

    Args:
        arguments: Options of the command.

    Raises:
        FormatError: If the file is missing, damaged, or of no trained network.
        TrainingError: If the package that reads ONNX is missing.
    """
    from svfl_models.deployment.exported_inspection import inspect_exported  # torch takes seconds to import
    from svfl_models.deployment.inspection import inspect

    found = (inspect_exported if arguments.network.suffix in EXPORTED else inspect)(arguments.network)
    report(arguments.json, found.plain(), *lines(found))


def lines(found: "Inspection") -> Iterator[str]:
    """Yield the facts in lines of text.

    Args:
        found: What is known of the network.
    """
    from svfl_models.training.provenance import words

    yield f"{found.path}: {printable(found.what, LONGEST_SAID)}"
    yield f"  written by     {found.program}, format {printable(found.format, 80)}"
    yield f"  file           {found.bytes} bytes, SHA-256 {found.sha256}"
    yield from _entries("inputs", found.inputs)
    yield f"  output         {printable(found.output, LONGEST_SAID)}"
    yield from _entries("network", found.network)
    yield from _entries("configuration", found.configuration)
    for number, session in enumerate(found.provenance, start=1):
        count = f" {number} of {len(found.provenance)}" if len(found.provenance) > 1 else ""
        yield f"  provenance{count}"
        yield from (f"    {line}" for line in words.lines(session))
    if not found.provenance:
        yield "  provenance     unknown: the file does not tell"
    for name, values in found.results.items():
        yield from _entries(f"results, {name}", values)


def _entries(title: str, values: Mapping[str, Any]) -> Iterator[str]:
    if values:
        yield f"  {title}"
    width = max((len(printable(name, 40)) for name in list(values)[:MOST_NAMED]), default=0)
    for name, value in list(values.items())[:MOST_NAMED]:
        if value not in (None, "", [], {}):
            yield f"    {printable(name, 40):<{width}} {_value(value)}"
    if len(values) > MOST_NAMED:
        yield f"    and {len(values) - MOST_NAMED} more"


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        inside = ", ".join(f"{name} {one}" for name, one in list(value.items())[:MOST_NAMED])
        return printable(inside, LONGEST_SAID)
    return printable(f"{value:,}" if type(value) is int else value, LONGEST_SAID)
