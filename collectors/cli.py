"""The command ``svfl-collect``."""

from collectors.commands import calibrate, centering, expert, policy, replay, tags, teleop
from svfl_data.system.command_line import Parser
from svfl_data.system.command_line import main as run

PROGRAM = "svfl-collect"
COMMANDS = (expert, centering, policy, replay, teleop, tags, calibrate)


def main() -> int:
    """Parse the command line, run the command that it names and return the exit code."""
    return run(build_parser())


def build_parser() -> Parser:
    """Return the parser of the command line of ``svfl-collect``, with all its commands."""
    root = Parser(
        prog=PROGRAM,
        description="Record episodes with images and forces, in simulation or on a robot of your own, by experts, "
        "persons and policies, and calibrate cameras.",
        example="svfl-collect expert --task block_picking --episodes 50 --workers 2 --seed 0 --out data/block_picking\n"
        "svfl-collect centering --episodes 200 --seed 0 --workers 2 --out data/centering",
    )
    commands = root.add_commands()
    for command in COMMANDS:
        command.add(commands)
    return root
