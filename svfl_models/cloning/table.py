"""Many clonings side by side: tasks, networks, numbers of demonstrations and seeds, each trained and tried once."""

import json
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from svfl_data.errors import SvflError, TrainingError
from svfl_models import run_folder
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.evaluate import wilson

RUNS = "runs"
GROUPS = {"svfl": "D4", "cnn": "none"}
"""The two networks that are compared -> group."""


@dataclass(frozen=True)
class Run:
    """One policy: how it is trained, and where it lies.

    Attributes:
        config: Of its training.
        folder: Of its checkpoint, metrics, result and evaluation.
    """

    config: CloningConfig
    folder: Path

    @property
    def task(self) -> str:
        """Name of its dataset's folder."""
        return Path(self.config.data).name

    def outcome(self, trials: int) -> dict[str, Any] | None:
        """What its training and its evaluation found; None unless both are done.

        Raises:
            TrainingError: If its folder holds a run with another configuration.
        """
        result, judged = (_read(self.folder / name) for name in (run_folder.RESULT, run_folder.EVALUATION))
        if result is None or judged is None or len(judged["success"]) != trials:
            return None
        if result["config"] != self.config.plain():
            raise TrainingError(f"{self.folder} holds a run with another configuration; choose another --out")
        return {**result["result"], "success": judged["success"]}


def runs(base: CloningConfig, data: Sequence[str], episodes: Sequence[int], seeds: int, out: Path) -> list[Run]:
    """Every policy of a table; those of fewer demonstrations train for more epochs, so that all take as many steps.

    Args:
        base: What all have in common; its epochs are those of the largest number of demonstrations.
        data: Dataset folders, one for each task.
        episodes: Numbers of demonstrations.
        seeds: 0 to this number, exclusive.
        out: Folder of the table.
    """
    configs = [
        replace(base, data=folder, episodes=count, epochs=base.epochs * max(episodes) // count, group=group, seed=seed)
        for seed in range(seeds)
        for folder in data
        for count in episodes
        for group in GROUPS.values()
    ]
    names = [f"{Path(one.data).name}_{one.encoder}_{one.model}_{one.episodes}_seed{one.seed}" for one in configs]
    return [Run(config, out / RUNS / name) for config, name in zip(configs, names, strict=True)]


def train_and_try(run: Run, trials: int) -> str:
    """Do what is left of a run: an interrupted training goes on after its last whole epoch."""
    import torch

    from svfl_models.cloning.evaluate import evaluate
    from svfl_models.cloning.train import train_cloning

    torch.set_num_threads(1)
    quiet = Console(quiet=True)
    found = _read(run.folder / run_folder.RESULT)
    if found is None or found["config"] != run.config.plain():
        train_cloning(run.config, run.folder, quiet)
    evaluation = evaluate(run.folder / run_folder.CHECKPOINT, trials, console=quiet)
    evaluation.save(run.folder / run_folder.EVALUATION)
    return f"{run.folder.name}: {evaluation.rate:.0%} of {trials}"


def complete(table: Sequence[Run], trials: int, workers: int, console: Console) -> None:
    """Train and try what is not done yet, in the order of the seeds; what is finished is kept whatever happens.

    Raises:
        TrainingError: If a folder holds another run, or workers die.
        SvflError: If data cannot serve or a training diverges.
        KeyboardInterrupt: If the user stopped it.
    """
    waiting = [run for run in table if run.outcome(trials) is None]
    columns = (TextColumn("policies"), MofNCompleteColumn(), BarColumn(), TextColumn("{task.description}"))
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal) as bar:
        shown = bar.add_task("", total=len(table), completed=len(table) - len(waiting))
        for words in _done(waiting, trials, workers):
            bar.update(shown, advance=1, description=words)
            if not console.is_terminal:
                console.print(words, highlight=False)


def _done(waiting: Sequence[Run], trials: int, workers: int) -> Iterator[str]:
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # workers inherit it: one core each
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _start_worker)
    try:
        jobs = {pool.submit(train_and_try, run, trials): run for run in waiting}
        for job in as_completed(jobs):
            try:
                yield job.result()
            except BrokenProcessPool as error:
                raise TrainingError("a worker process died (killed, or out of memory); run the same again") from error
            except SvflError as error:
                raise type(error)(f"{jobs[job].folder.name}: {error}") from error
    finally:
        # A worker that is still at it is ended: its last whole epoch is on disk.
        for process in list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(cancel_futures=True)


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle


def _read(file: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(file.read_text())
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


@dataclass(frozen=True)
class Rate:
    """How often policies of several seeds succeeded.

    Attributes:
        by_seed: Share of each, 0..1.
        successes: Of all together.
        trials: Of all together.
    """

    by_seed: list[float]
    successes: int
    trials: int

    @classmethod
    def of(cls, outcomes: Sequence[dict[str, Any]]) -> "Rate":
        """From the outcomes of the seeds."""
        tried = [one["success"] for one in outcomes]
        return cls([sum(one) / len(one) for one in tried], sum(map(sum, tried)), sum(map(len, tried)))

    @property
    def share(self) -> float:
        """Of all trials, 0..1."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Of `share`, 95 %, for scenes drawn anew; seeds' differences are not in it."""
        return wilson(self.successes, self.trials)
