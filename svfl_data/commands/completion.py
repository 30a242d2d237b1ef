"""``svfl-data completion``: print the code that completes command lines in a shell."""

import argparse
import sys

from svfl_data.system.command_line import Commands
from svfl_data.system.command_line.completion import PROGRAMS, SHELLS, shell_code


def add(commands: Commands) -> None:
    """Add the command ``completion`` and its arguments to the command line."""
    parser = commands.add_parser(
        "completion",
        help="print the code that completes the command lines of all programs in a shell",
        description="Print the code with which a shell completes commands, options and values of "
        f"{', '.join(PROGRAMS)} at the Tab key. The code works in the environment in which the programs are found.",
        example='svfl-data completion bash   # in ~/.bashrc: eval "$(svfl-data completion bash)"\n'
        'svfl-data completion zsh   # in ~/.zshrc: eval "$(svfl-data completion zsh)"\n'
        "svfl-data completion fish | source   # in ~/.config/fish/config.fish",
    )
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"shell: {', '.join(SHELLS)}")
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Print the code."""
    sys.stdout.write(shell_code(arguments.shell))
