"""Many runs, side by side, each of them once."""

import os
from collections import deque
from collections.abc import Mapping
from multiprocessing import connection
from pathlib import Path

from rich.console import Console

from svfl_data.errors import TrainingError
from svfl_models.experiments.runs.progress_bar import Bar
from svfl_models.experiments.runs.worker import Job, Worker, devices

LOG = "workers.log"
TOLD = 3
"""So many failed runs are named; of more, the number."""


class Grid:
    """Runs of an experiment in its folder.

    Args:
        out: Folder of the experiment, held by this process (`folder.held`).
        jobs: The runs by name.

    Attributes:
        failed: Why runs failed, by name, in this process.
    """

    def __init__(self, out: Path, jobs: Mapping[str, Job]) -> None:
        self.log, self.jobs = out / LOG, jobs
        self.failed: dict[str, str] = {}

    def unfinished(self) -> list[str]:
        """Names of the runs that are still to be done, the longest first: so no core waits for a long one at the end.

        Raises:
            TrainingError: If something else is where a run's files should be.
        """
        names = [name for name, job in self.jobs.items() if job.words() is None]
        return sorted(names, key=lambda name: self.jobs[name].cost, reverse=True)

    def run(self, workers: int, console: Console) -> None:
        """Do what is unfinished; a run that fails is noted in `failed`, and the others go on.

        Args:
            workers: Processes. On a machine with GPUs, they take turns in getting one.
            console: Where progress goes.

        Raises:
            SvflError: If what has happened would happen to every run, such as a full disk.
            KeyboardInterrupt: If the user stopped it; finished runs are kept.
        """
        waiting = deque(self.unfinished())
        if not waiting:
            return
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # workers inherit it: one core each
        names = devices()
        crew: dict[int, Worker] = {}
        try:
            with Bar(self.jobs, waiting, console) as bar:
                while waiting or any(one.name for one in crew.values()):
                    for place in range(workers):
                        if waiting and place not in crew:
                            crew[place] = Worker(names[place % len(names)], self.log)
                        if waiting and crew[place].name is None:
                            name = waiting.popleft()
                            crew[place].begin(name, self.jobs[name])
                    busy = {one.connection: place for place, one in crew.items() if one.name}
                    for ready in connection.wait(list(busy)):
                        name, words = self._end(crew, busy[ready])  # type: ignore[index] # what was given comes back
                        bar.ended(name, words)
        finally:
            for one in crew.values():
                one.process.terminate()  # all at once, for `end` waits
            for one in crew.values():
                one.end()

    def raise_failures(self) -> None:
        """Name the runs that failed, if any did.

        Raises:
            TrainingError: With their reasons.
        """
        if not self.failed:
            return
        named = "; ".join(f"{name}: {why}" for name, why in list(self.failed.items())[:TOLD])
        more = f"; and {len(self.failed) - TOLD} more" if len(self.failed) > TOLD else ""
        count = f"{len(self.failed)} of {len(self.jobs)} runs"
        raise TrainingError(f"{count} failed ({named}{more}); the same command tries them again")

    def _end(self, crew: dict[int, Worker], place: int) -> tuple[str, str]:
        """Note how a run ended; returns its name and that in words. A worker that died leaves its place."""
        name = str(crew[place].name)
        try:
            error = crew[place].outcome()
        except EOFError:
            dead = crew.pop(place)
            error = TrainingError(f"its process died with exit code {dead.exit_code()}, see {self.log}")
            dead.end()
        if error is None:
            return name, self.jobs[name].words() or "no result"
        if not isinstance(error, TrainingError):
            raise error
        self.failed[name] = str(error)
        return name, "failed"
