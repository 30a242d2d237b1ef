"""Many runs, side by side, each of them once."""

from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from rich.console import Console

from svfl_data.errors import TrainingError
from svfl_data.system.worker_processes import Died, run_jobs
from svfl_models.experiments.runs.job import Job, devices, prepare
from svfl_models.experiments.runs.progress_bar import Bar

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
        waiting = self.unfinished()
        if not waiting:
            return
        jobs = deque((name, self.jobs[name]) for name in waiting)
        with Bar(self.jobs, waiting, console) as bar:
            for (name, _), error in run_jobs(partial(prepare, devices(), self.log), jobs, workers, finish=False):
                bar.ended(name, self._note(name, error))

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

    def _note(self, name: str, error: TrainingError | Died | None) -> str:
        """Note how a run ended; returns that in words."""
        if error is None:
            return self.jobs[name].words() or "no result"
        if isinstance(error, Died):
            self.failed[name] = f"its process died with exit code {error.exit_code}, see {self.log}"
        else:
            self.failed[name] = str(error)
        return "failed"
