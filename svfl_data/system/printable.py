"""Conversion of text that came from a file into text that is harmless to print, draw or log.

For example, a task name can hold escape sequences that take over a terminal, line ends that forge further lines of
output, and control characters that reverse the order in which text is shown.
"""

import re
import unicodedata

LONGEST_LINE = 4000  # [characters] of a printed line
ESCAPED = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode categories of characters that have no visible shape: controls, formats (including bidirectional ones),
surrogates, private-use and unassigned characters, line and paragraph separators."""


def printable(text: object, limit: int = 500) -> str:
    r"""Return text as one line of visible characters.

    Args:
        text: Object to convert. An object that is not a string is converted with ``str`` first.
        limit: Largest number of characters, counted before escaping. A longer text is cut and ends with an ellipsis.

    Returns:
        The text with every character that has no visible shape written as an escape such as ``\x1b``.
    """
    whole = str(text)
    cut = whole if len(whole) <= limit else whole[: limit - 1] + "…"
    return "".join(c.encode("unicode_escape").decode() if _is_hidden(c) else c for c in cut)


def say(*lines: object) -> None:
    """Print lines on standard output, each converted by `printable` so that it stays a single line.

    Args:
        *lines: Objects to print, one per line.
    """
    for line in lines:
        print(printable(line, LONGEST_LINE), flush=True)


def markdown(text: object) -> str:
    """Return text with escapes, so that Markdown shows it without markup, table cells, links, pictures or HTML."""
    plain = re.sub(r"([\\`*\[\]<>|~&$@#]|(?<![0-9A-Za-z])_|_(?![0-9A-Za-z]))", r"\\\1", printable(text))
    return plain.replace("://", "\\://").replace("www.", "www\\.")  # GitHub's Markdown makes links of these


def _is_hidden(character: str) -> bool:
    return not (character.isascii() and character.isprintable()) and unicodedata.category(character) in ESCAPED
