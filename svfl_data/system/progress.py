"""A progress bar for work that may take long."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")
FEW = 100
"""Largest number of items for which no progress bar is shown."""


def progress(items: Sequence[Item] | Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items of a collection, and show a progress bar if there are many and a person is watching.

    The bar is shown on standard error, if that is a terminal.

    Args:
        items: Items to go through.
        doing: Description of the work, which is shown beside the bar.
        total: Number of items. It is needed only if `items` is not a sequence; without it no bar is shown then.
    """
    count = total if total is not None else len(items) if isinstance(items, Sequence) else 0
    if count <= FEW:
        yield from items
        return
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    yield from track(items, doing, total=count, console=console, transient=True, disable=not console.is_terminal)
