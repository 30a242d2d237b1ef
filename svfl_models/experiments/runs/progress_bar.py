"""Progress of many runs: a bar on a terminal, a line per finished run elsewhere."""

from collections.abc import Iterable, Mapping
from typing import Self

from rich.console import Console

from svfl_data.system.printable import printable
from svfl_data.system.progress.bars import Bars
from svfl_models.experiments.runs.job import Job


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
        self.bars = Bars(console)
        self.console = self.bars.console
        self.bar = self.bars.add("runs", sum(self.costs.values()), count=self._done())

    def __enter__(self) -> Self:
        self.bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.bars.stop()

    def ended(self, name: str, words: str) -> None:
        """Show that a run has ended.

        Args:
            name: Name of the run.
            words: Outcome of the run in words.
        """
        self.done += 1
        self.bars.update(self.bar, advance=self.costs[name], count=self._done(), words=f"{name}: {words}")
        if not self.bars.shown:
            said = printable(f"{self._done()} {name}: {words}")
            self.console.print(said, highlight=False, markup=False, soft_wrap=True)

    def _done(self) -> str:
        return f"{self.done}/{self.total}"
