"""Suggestions in place of a name that does not exist."""

from collections.abc import Collection, Iterable

LEAST_ALIKE, AS_ALIKE = 0.7, 0.05
"""Smallest similarity of a name that is suggested, 0 to 1, and how much less similar than the most similar one it may
be."""
LONGEST = 100  # [characters] of a name for which similar ones are sought


def near(asked: str, names: Iterable[str]) -> list[str]:
    """Return the names that are spelt almost like the one that was asked for, the nearest first.

    Args:
        asked: Name that was asked for.
        names: Names that exist.
    """
    from difflib import SequenceMatcher

    alike = {name: SequenceMatcher(None, name, asked).ratio() for name in names}
    least = max([LEAST_ALIKE, *(ratio - AS_ALIKE for ratio in alike.values())])
    return sorted((name for name, ratio in alike.items() if ratio >= least), key=lambda name: -alike[name])


def instead(asked: str, names: Collection[str]) -> str:
    """Return what could have been asked: names that are spelt almost the same, or otherwise all names.

    Args:
        asked: Name that does not exist.
        names: Names that exist.

    Returns:
        The words, such as ``did you mean block_picking?`` or ``possible are front, top``.

    Example:
        >>> instead("frnt", ["front", "top"])
        'did you mean front?'
    """
    alike = near(asked, names) if len(asked) < LONGEST else []
    return f"did you mean {' or '.join(alike)}?" if alike else f"possible are {', '.join(names)}"
