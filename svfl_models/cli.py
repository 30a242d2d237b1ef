"""The ``svfl-train`` command."""

from svfl_data.system.command_line import Parser
from svfl_data.system.command_line import main as run
from svfl_models.commands import (
    bc,
    bc_table,
    centering,
    check,
    evaluate,
    experiments,
    export,
    info,
    latent,
    latent_eval,
    rerun,
)

PROGRAM = "svfl-train"
COMMANDS = (centering, check, experiments, export, bc, bc_table, evaluate, latent, latent_eval, info, rerun)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line, run the command that it names and return the exit code.

    Args:
        arguments: Words of the command line after the program's name. None means those of this process.

    Returns:
        The exit code of the process.

    Raises:
        SystemExit: After ``--help``, and with code 2 after a mistake in the command line.
    """
    return run(build_parser(), arguments)


def build_parser() -> Parser:
    """Return the argument parser of ``svfl-train``, with one subparser per command."""
    root = Parser(
        prog=PROGRAM,
        description="Train, evaluate and export symmetric networks that use images and forces.",
        example=centering.EXAMPLE,
    )
    commands = root.add_commands()
    for command in COMMANDS:
        command.add(commands)
    return root
