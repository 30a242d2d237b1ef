"""From an index to a dataset: what is missing is collected, whichever executor runs the workers."""

from contextlib import ExitStack
from functools import cache
from importlib.metadata import version

from collectors.recording import processes
from collectors.recording.progress import CollectionProgress
from collectors.recording.worker import FAILURES, Collected, Collector, Executor, Worker
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import SvflError


def software_versions(*packages: str) -> dict[str, str]:
    """Installed versions of packages, by name, to be stored with what they recorded."""
    return {package: _version(package) for package in packages}


_version = cache(version)  # looking one up takes 2 ms


def collect_dataset(
    dataset: Dataset,
    episodes: int,
    workers: int,
    collector: Collector,
    executor: Executor = processes.run,
    keep_failures: bool = False,
    progress: CollectionProgress | None = None,
) -> list[Collected]:
    """Collect the episodes 0 .. episodes-1 that a dataset does not have yet.

    Args:
        dataset: Where to write; held for the duration.
        episodes: How many episodes it shall have.
        workers: How many work at a time; what is collected does not depend on it.
        collector: Makes the episodes; sent to each worker.
        executor: Runs the workers.
        keep_failures: Whether to write failed attempts into a dataset of their own, in the folder `FAILURES` inside.
        progress: Where to show how it goes; by itself if not given.

    Returns:
        What was collected now, by completion.

    Raises:
        CollectError: If workers keep dying.
        StorageError: If the dataset's folder is removed or renamed meanwhile; it is never made again.
        SvflError: Whatever a collector raises; episodes finished before are on disk.
    """
    info = dataset.info
    with ExitStack() as stack:
        held = stack.enter_context(dataset.writing())
        worker = Worker(
            collector, dataset.path, info["task"], info["seed"], info["config"], keep_failures, held.identity
        )
        if keep_failures:
            stack.enter_context(worker.dataset(FAILURES).writing())
        shown = progress or stack.enter_context(CollectionProgress())
        have = set(dataset.indices)
        missing = [index for index in range(episodes) if index not in have]
        done: list[Collected] = []
        shown.begin(info["task"], episodes, len(missing))
        try:
            for finished in executor(missing, workers, worker) if missing else ():
                held.check()
                done.append(finished)
                shown.advance(finished)
        except SvflError:
            held.check()  # a folder that is gone explains what a worker ran into, and this process knows more of it
            raise
        return done
