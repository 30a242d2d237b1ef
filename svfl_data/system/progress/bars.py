"""Progress bars in one layout: what is done, a bar, how many, what was found so far, and the time left.

A line fits the width of the terminal, of which 80 columns are enough: the bar takes what the words leave, and words
that leave too little for it are cut.
"""

import sys
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Column
from rich.text import Text

from svfl_data.system.printable import printable
from svfl_data.system.progress import is_quiet, progress_console

SHORTEST_BAR = 5  # [columns]
LONGEST_NAME = 26  # [characters] of what is done, as long as the longest name of a task
TIME_LEFT = len("0:00:00 left")
SPACES = 4  # between the five columns
DAY_S = 86400.0
"""Time over which the speed is estimated, [s]. The usual 30 s may be shorter than one piece of work."""


class Bars:
    """Display of one or several progress bars, which is used as a context manager.

    Nothing is shown if the console is no terminal or is quiet, or in a block of `quiet`.

    Args:
        console: Console to show the bars on. None means `progress_console`.
        transient: Whether the bars vanish at the end.

    Attributes:
        console: Console on which lines that replace the bars are printed.
        shown: Whether the bars are shown.
    """

    def __init__(self, console: Console | None = None, transient: bool = True) -> None:
        self.console = progress_console() if console is None or is_quiet() else console
        self.shown = self.console.is_terminal and not self.console.quiet
        self._bars = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=None, table_column=Column(ratio=1)),
            _Count(table_column=Column(no_wrap=True, justify="right")),
            _Words(self._room, Column(no_wrap=True)),
            _Left(table_column=Column(no_wrap=True, justify="right")),
            console=self.console,
            disable=not self.shown,
            expand=True,
            redirect_stdout=sys.stdout.isatty(),  # otherwise results in a pipe would go to the terminal
            transient=transient,
            speed_estimate_period=DAY_S,
        )

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Show the bars."""
        self._bars.start()

    def stop(self) -> None:
        """Show the bars no longer; a second call does nothing."""
        self._bars.stop()

    def add(self, doing: str, total: float, completed: int = 0, count: str = "") -> TaskID:
        """Add a bar and return its handle.

        Args:
            doing: What is done, or the name of what is counted.
            total: Amount of work.
            completed: Amount that is done already.
            count: How many are done, in words; by default the two amounts.
        """
        name = printable(doing, LONGEST_NAME)
        return self._bars.add_task(name, total=total, completed=completed, words="", count=count)

    def update(
        self,
        bar: TaskID,
        *,
        advance: float | None = None,
        completed: float | None = None,
        words: str | None = None,
        count: str | None = None,
    ) -> None:
        """Move a bar, or change its words.

        Args:
            bar: Handle of the bar.
            advance: Amount of work by which to move the bar.
            completed: Amount of work that is done.
            words: What was found so far.
            count: How many are done, in words.
        """
        given = {"words": words and printable(words), "count": count}
        fields: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        self._bars.update(bar, advance=advance, completed=completed, **fields)

    def _room(self, task: Task) -> int:
        """Return how many columns are left for the words of a bar if the bar itself is as short as it may be."""
        tasks = self._bars.tasks
        name, count = max(len(one.description) for one in tasks), max(len(_count(one)) for one in tasks)
        return max(self.console.width - name - count - SHORTEST_BAR - TIME_LEFT - SPACES, 1)


def _count(task: Task) -> str:
    return str(task.fields["count"] or f"{task.completed:.0f}/{task.total:.0f}")


class _Count(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(_count(task), style="progress.download")


class _Words(ProgressColumn):
    def __init__(self, room: Callable[[Task], int], table_column: Column) -> None:
        super().__init__(table_column)
        self._room = room

    def render(self, task: Task) -> Text:
        words = Text(task.fields["words"])
        words.truncate(self._room(task), overflow="ellipsis")
        return words


class _Left(TimeRemainingColumn):
    def render(self, task: Task) -> Text:
        return Text.assemble(super().render(task), " left")
