"""The ``svfl-train`` command."""

from svfl_data.system.command_line import Parser
from svfl_data.system.command_line import main as run
from svfl_models.commands import bc, bc_table, centering, check, evaluate, experiments, export, latent, latent_eval

PROGRAM = "svfl-train"
COMMANDS = (centering, check, experiments, export, bc, bc_table, evaluate, latent, latent_eval)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line and train; returns the exit code."""
    return run(build_parser(), arguments)


def build_parser() -> Parser:
    """Arguments of the command."""
    root = Parser(prog=PROGRAM, description="Train symmetric visual-force networks.", example=centering.EXAMPLE)
    commands = root.add_subparsers(
        title="commands", dest="command_name", metavar="COMMAND", required=True, parser_class=Parser
    )
    for command in COMMANDS:
        command.add(commands)
    return root
