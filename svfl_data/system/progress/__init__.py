"""Progress of work that may take long: a bar on a terminal, none elsewhere, and none with ``--quiet``."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, TypeVar

from svfl_data.system.printable import printable

if TYPE_CHECKING:
    from rich.console import Console

Item = TypeVar("Item")
FEW = 100
"""Largest number of items for which no progress bar is shown."""
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


@contextmanager
def quiet(wanted: bool = True) -> Iterator[None]:
    """Show no progress in the block.

    Args:
        wanted: Whether to be quiet. If False, the block shows progress only where it would be shown outside the block.
    """
    before = _QUIET.set(wanted or _QUIET.get())
    try:
        yield
    finally:
        _QUIET.reset(before)


def is_quiet() -> bool:
    """Return whether no progress is to be shown, as in a block of `quiet`."""
    return _QUIET.get()


def progress_console() -> "Console":
    """Return the console for progress: standard error, or a silent console in a block of `quiet`."""
    from rich.console import Console

    return Console(stderr=True, quiet=_QUIET.get())


def progress_line(words: object) -> None:
    """Print a line about progress on `progress_console`, as one harmless line."""
    progress_console().print(printable(words), markup=False, highlight=False, soft_wrap=True)


def progress(items: Sequence[Item] | Iterable[Item], doing: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items of a collection, and show a progress bar if there are many and a person is watching.

    Args:
        items: Items to go through.
        doing: Description of the work, which is shown beside the bar.
        total: Number of items. It is needed only if `items` is not a sequence; without it no bar is shown then.
    """
    count = total if total is not None else len(items) if isinstance(items, Sequence) else 0
    if count <= FEW:
        yield from items
        return
    from svfl_data.system.progress.bars import Bars

    with Bars() as bars:
        bar = bars.add(doing, count)
        for item in items:
            yield item
            bars.update(bar, advance=1)
