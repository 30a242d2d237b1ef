"""Progress of many runs: a bar on a terminal, a line per finished run elsewhere."""

from collections.abc import Iterable, Mapping
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from svfl_data.system.printable import printable
from svfl_models.experiments.runs.job import Job

DAY_S = 86400.0


class Bar:
    """Progress bar of many runs.

    The bar is a context manager, so that it is always removed from the terminal.

    Args:
        jobs: All runs by name.
        waiting: Names of the runs that are still to be done.
        console: Console to show the progress on.
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
        # By default the speed is estimated from the last 30 s, in which perhaps no run has ended.
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
        """Show that a run has ended.

        Args:
            name: Name of the run.
            words: Outcome of the run in words.
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
