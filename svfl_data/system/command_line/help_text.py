"""Help texts that fit the width of the terminal, in which examples stay commands that can be copied."""

import argparse
import re

EXAMPLE = "example:\n"
INDENT = "  "
FURTHER = "      "
"""Indentation of the further lines of a command that does not fit one line."""
COMMENT = re.compile(r"\s+#\s+")
WORD = r"""(?:[^\s'"]|'[^']*'|"[^"]*")+"""
UNIT = re.compile(f"--?[a-z][a-z-]* (?!-){WORD}|{WORD}")
"""What stands on one line: a word, or an option with the first word after it."""


class Formatter(argparse.HelpFormatter):
    """Wraps usage, descriptions and examples to the width of the terminal."""

    def add_argument(self, action: argparse.Action) -> None:
        """Add an argument to the help; the names of commands get their full width, of which argparse forgets a part."""
        super().add_argument(action)
        if isinstance(action, argparse._SubParsersAction):
            self._action_max_length += self._indent_increment

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if not text.startswith(EXAMPLE):
            return super()._fill_text(text, width, indent)
        commands = text.removeprefix(EXAMPLE).replace("\\\n", " ").splitlines()
        return EXAMPLE + "\n".join(line for command in commands for line in example_lines(command, width))

    def _format_usage(self, *args: object) -> str:
        """Break also what argparse takes for one long word: options that exclude each other, and lists of choices."""
        usage = super()._format_usage(*args)  # type: ignore[arg-type]  # passed on as argparse gives it
        return "\n".join(piece for line in usage.split("\n") for piece in _broken(line, self._width))


def example_lines(command: str, width: int) -> list[str]:
    r"""Return a command of an example in lines of a limited width, which a shell still reads as one command.

    Args:
        command: Command, perhaps with a comment after `` # ``.
        width: Largest width of a line, if the words of the command allow it [characters].

    Returns:
        The lines, indented. All but the last one of the command end in a backslash. A comment that does not fit beside
        its command stands above it.
    """
    words, *comment = COMMENT.split(command.strip(), maxsplit=1)
    if comment and len(INDENT + command.strip()) <= width:
        return [INDENT + command.strip()]
    pieces: list[list[str]] = [[]]
    for unit in UNIT.findall(words):
        if pieces[-1] and len(" ".join([FURTHER[1:], *pieces[-1], unit, "\\"])) > width:
            pieces.append([])
        pieces[-1].append(unit)
    lines = [(FURTHER if number else INDENT) + " ".join(piece) for number, piece in enumerate(pieces)]
    return [*(f"{INDENT}# {one}" for one in comment), *(f"{line} \\" for line in lines[:-1]), lines[-1]]


def _broken(line: str, width: int) -> list[str]:
    pieces = []
    begin = " " * (len(line) - len(line.lstrip()) + 1)
    while len(line) > width and (cut := max(line.rfind(mark, len(begin), width) for mark in (" ", ","))) > 0:
        pieces.append(line[: cut + 1].rstrip())
        line = begin + line[cut + 1 :].lstrip()
    return [*pieces, line]
