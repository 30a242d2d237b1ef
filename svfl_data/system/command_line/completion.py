"""Completion of command lines by a shell, which gets the possible words from the programs."""

import os

from svfl_data.system.command_line.parser import Parser

PROGRAMS = ("svfl-data", "svfl-collect", "svfl-train")
SHELLS = ("bash", "zsh", "fish")
ASKING = "_ARGCOMPLETE"
"""Environment variable that is set by a shell that asks for the possible words."""


def answer(root: Parser) -> None:
    """Answer a shell that asks for the possible words, and end the process; do nothing if no shell asks.

    Args:
        root: Parser of the program.
    """
    if ASKING not in os.environ:
        return
    import argcomplete  # only here: an ordinary start needs none of it

    argcomplete.autocomplete(root, always_complete_options=False)  # options only after a dash


def shell_code(shell: str) -> str:
    """Return the code that makes a shell ask the three programs for the possible words.

    Args:
        shell: Shell, one of `SHELLS`.
    """
    import argcomplete

    return argcomplete.shellcode(list(PROGRAMS), shell=shell)
