"""Shows how far many runs are: a bar on a terminal, a line per run elsewhere."""

from collections.abc import Iterable, Mapping
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from svfl_data.system.printable import printable
from svfl_models.experiments.runs.job import Job

DAY_S = 86400.0


class Bar:
    """The bar; a context, since it must leave the terminal as it was.

    Args:
        jobs: All runs by name.
        waiting: Names of those that are still to be done.
        console: Where to show it.
    """

    def __init__(self, jobs: Mapping[str, Job], waiting: Iterable[str], console: Console) -> None:
        self.costs = {name: jobs[name].cost for name in waiting}
        self.total, self.done = len(jobs), len(jobs) - len(self.costs)
        self.console = console
        columns = (
            TextColumn("runs {task.fields[done]}"),
            BarColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.description}", markup=False),
        )
        # By default the speed is that of the last 30 s, in which no run may have ended.
        self.bar = Progress(*columns, console=console, transient=True, speed_estimate_period=DAY_S)
        self.task = self.bar.add_task("", total=sum(self.costs.values()), done=self._done())

    def __enter__(self) -> Self:
        if self.console.is_terminal:
            self.bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self.console.is_terminal:
            self.bar.stop()

    def ended(self, name: str, words: str) -> None:
        """A run is over.

        Args:
            name: Of the run.
            words: How it went.
        """
        self.done += 1
        self.bar.update(
            self.task, advance=self.costs[name], done=self._done(), description=printable(f"{name}: {words}")
        )
        if not self.console.is_terminal:
            said = printable(f"{self._done()} {name}: {words}")
            self.console.print(said, highlight=False, markup=False, soft_wrap=True)

    def _done(self) -> str:
        return f"{self.done}/{self.total}"
