"""Making text that came from a file harmless before it is printed, drawn or logged.

A task name can hold escape sequences that take over a terminal, line ends that forge further lines of output, and
controls that reverse the order in which text is shown.
"""

import re
import unicodedata

LONGEST_LINE = 4000  # characters of what is printed
ESCAPED = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode categories of what has no shape of its own: controls, formats (bidirectional ones among them), surrogates,
private and unassigned characters, line and paragraph separators."""


def printable(text: object, limit: int = 500) -> str:
    r"""Text in one line of visible characters.

    Args:
        text: Anything; what is not a string is converted to one.
        limit: Most characters to take from it; what is cut off is replaced by an ellipsis.

    Returns:
        The text with every character that has no visible shape written as an escape such as ``\x1b``.
    """
    whole = str(text)
    cut = whole if len(whole) <= limit else whole[: limit - 1] + "…"
    return "".join(c.encode("unicode_escape").decode() if _is_hidden(c) else c for c in cut)


def say(*lines: object) -> None:
    """Print lines on standard output, each made harmless; none of them makes two."""
    for line in lines:
        print(printable(line, LONGEST_LINE), flush=True)


def markdown(text: object) -> str:
    """Text that stands in Markdown as it is: no markup, table cell, link, picture or HTML of its own."""
    plain = re.sub(r"([\\`*\[\]<>|~&$@#]|(?<![0-9A-Za-z])_|_(?![0-9A-Za-z]))", r"\\\1", printable(text))
    return plain.replace("://", "\\://").replace("www.", "www\\.")  # GitHub's Markdown makes links of these


def _is_hidden(character: str) -> bool:
    return not (character.isascii() and character.isprintable()) and unicodedata.category(character) in ESCAPED
