"""The ``svfl-train`` command."""

import functools

from svfl_data.cli import Parser, run
from svfl_data.errors import TrainingError
from svfl_models.verbs import bc, bc_table, centering, check, evaluate, experiments, export, latent, latent_eval

PROGRAM = "svfl-train"
VERBS = (centering, check, experiments, export, bc, bc_table, evaluate, latent, latent_eval)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line and train; returns the exit code."""
    chosen = build_parser().parse_args(arguments)
    return run(functools.partial(_run, chosen.command, chosen), PROGRAM)


def _run(command: functools.partial[None], chosen: object) -> None:
    try:
        command(chosen)
    except ImportError as error:
        raise TrainingError(f"training needs a package that is missing here: {error}") from error


def build_parser() -> Parser:
    """Arguments of the command."""
    root = Parser(prog=PROGRAM, description="Train symmetric visual-force networks.", example=centering.EXAMPLE)
    commands = root.add_subparsers(title="verbs", metavar="VERB", required=True, parser_class=Parser)
    for verb in VERBS:
        verb.add(commands)
    return root
