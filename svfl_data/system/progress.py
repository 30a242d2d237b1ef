"""A progress bar for work that may take long."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")
FEW = 100
"""Up to so many episodes nobody needs a bar."""


def progress(items: Sequence[Item] | Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
    """Go through items, with a bar on standard error if there are many and a person is looking.

    Args:
        items: What to go through.
        doing: What is being done, for the bar.
        total: How many there are, if `items` does not know.
    """
    count = total if total is not None else len(items) if isinstance(items, Sequence) else 0
    if count <= FEW:
        yield from items
        return
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    yield from track(items, doing, total=count, console=console, transient=True, disable=not console.is_terminal)
