"""From samples to a dataset: workers, resuming, progress, and an honest count of what was rejected."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from svfl_data.dataset import Dataset
from svfl_data.episode import Episode
from svfl_data.errors import CollectError
from svfl_data.store import write_episode

Collector = Callable[[int], Episode]
"""Produces the episode of an index; depends on nothing but the index and what it was made with."""

_collect: Collector  # of this worker process
_folder: Path


def software_versions(*packages: str) -> dict[str, str]:
    """Installed versions of packages, by name, to be stored with what they recorded."""
    return {package: version(package) for package in packages}


@dataclass(frozen=True)
class Collected:
    """What a worker reports of one finished episode."""

    index: int
    steps: int


def collect_dataset(dataset: Dataset, samples: int, workers: int, collector: Collector) -> list[Collected]:
    """Collect the episodes 0 .. samples-1 that a dataset does not have yet.

    Args:
        dataset: Where to write; held for the duration.
        samples: How many episodes it shall have.
        workers: Processes to collect with; what is collected does not depend on it.
        collector: Makes the episodes; sent to each worker process.

    Returns:
        What was collected now, by completion.

    Raises:
        CollectError: If a worker process dies.
        SvflError: Whatever a collector raises; episodes finished before are on disk.
    """
    with dataset.writing():
        have = set(dataset.indices)
        missing = [index for index in range(samples) if index not in have]
        done: list[Collected] = []
        with _progress() as progress:
            bar = progress.add_task(dataset.info["task"], total=samples, completed=samples - len(missing))
            for finished in _run(missing, min(workers, len(missing)), collector, dataset.path):
                done.append(finished)
                progress.advance(bar)
        return done


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("samples"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip


def _run(indices: list[int], workers: int, collector: Collector, folder: Path) -> Iterator[Collected]:
    if not indices:
        return
    # Fresh processes: a forked one would inherit the parent's threads and locks.
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _start_worker, (collector, folder))
    waiting = iter(indices)
    running: set[Future[Collected]] = set()
    try:
        while True:
            # A short queue: what is not started yet is what Ctrl-C need not wait for.
            while len(running) < 2 * workers and (index := next(waiting, None)) is not None:
                running.add(pool.submit(_collect_one, index))
            if not running:
                return
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    except BrokenProcessPool as error:
        raise CollectError(
            "a worker process died (killed, or out of memory); what was finished is on disk, the same command resumes"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


def _start_worker(collector: Collector, folder: Path) -> None:
    global _collect, _folder
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle; a started episode is finished
    _collect, _folder = collector, folder


def _collect_one(index: int) -> Collected:
    episode = _collect(index)
    write_episode(episode, Dataset.open(_folder).episode_path(index))
    return Collected(index, len(episode))
