"""Running of many runs in parallel, each of them once."""

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
"""Largest number of failed runs that an error message names; for the others it gives their number."""


class Grid:
    """The runs of an experiment, which are done in parallel.

    Args:
        out: Folder of the experiment, locked by this process (`folder.held`) while runs are done.
        jobs: Runs of the experiment by name.

    Attributes:
        failed: Messages of the runs that failed in this process, by name of the run.
    """

    def __init__(self, out: Path, jobs: Mapping[str, Job]) -> None:
        self.log, self.jobs = out / LOG, jobs
        self.failed: dict[str, str] = {}

    def unfinished(self) -> list[str]:
        """Return the names of the runs that are not finished, the longest first.

        In this order no core has to wait for a long run at the end.

        Raises:
            TrainingError: If the folder of a run holds something else.
        """
        names = [name for name, job in self.jobs.items() if job.words() is None]
        return sorted(names, key=lambda name: self.jobs[name].cost, reverse=True)

    def run(self, workers: int, console: Console) -> None:
        """Do the unfinished runs; a run that fails is recorded in `failed`, and the others continue.

        Args:
            workers: Number of processes. On a machine with GPUs, the GPUs are assigned to them in turn.
            console: Console to show the progress on.

        Raises:
            SvflError: If an error occurs that would occur in every run, such as a full disk.
            KeyboardInterrupt: If the user stopped the runs; finished runs are kept.
        """
        waiting = self.unfinished()
        if not waiting:
            return
        jobs = deque((name, self.jobs[name]) for name in waiting)
        with Bar(self.jobs, waiting, console) as bar:
            for (name, _), error in run_jobs(partial(prepare, devices(), self.log), jobs, workers, finish=False):
                bar.ended(name, self._note(name, error))

    def raise_failures(self) -> None:
        """Raise an error that names the runs that failed, if any did.

        Raises:
            TrainingError: If runs failed; the message names up to `TOLD` of them, each with its error.
        """
        if not self.failed:
            return
        named = "; ".join(f"{name}: {why}" for name, why in list(self.failed.items())[:TOLD])
        more = f"; and {len(self.failed) - TOLD} more" if len(self.failed) > TOLD else ""
        count = f"{len(self.failed)} of {len(self.jobs)} runs"
        raise TrainingError(f"{count} failed ({named}{more}); the same command tries them again")

    def _note(self, name: str, error: TrainingError | Died | None) -> str:
        """Note how a run ended, and return it in words."""
        if error is None:
            return self.jobs[name].words() or "no result"
        if isinstance(error, Died):
            self.failed[name] = f"its process died with exit code {error.exit_code}, see {self.log}"
        else:
            self.failed[name] = str(error)
        return "failed"
