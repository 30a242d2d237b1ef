"""Collection of the missing episodes of a dataset by workers, whichever executor runs them."""

from contextlib import ExitStack
from functools import cache
from importlib.metadata import version

from collectors.recording import processes
from collectors.recording.progress import CollectionProgress
from collectors.recording.worker import FAILURES, Collected, Collector, Executor, Worker
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import SvflError


def software_versions(*packages: str) -> dict[str, str]:
    """Return the installed versions of packages by name, to be stored with the episodes that the packages recorded."""
    return {package: _version(package) for package in packages}


_version = cache(version)  # the cache saves 2 ms for each look-up


def collect_dataset(
    dataset: Dataset,
    episodes: int,
    workers: int,
    collector: Collector,
    executor: Executor = processes.run,
    keep_failures: bool = False,
    progress: CollectionProgress | None = None,
) -> list[Collected]:
    """Collect the episodes 0 to ``episodes - 1`` that a dataset does not have yet.

    Args:
        dataset: Dataset to write the episodes to, which no other process can collect into until this function returns.
        episodes: Number of episodes that the dataset shall have.
        workers: Number of workers that run at a time, which does not change what is collected.
        collector: Collector that makes the episodes, which is sent to each worker.
        executor: Function that runs the workers; processes of this machine by default.
        keep_failures: Whether to write failed attempts into a dataset of their own, in the folder `FAILURES` inside the
            dataset's folder.
        progress: Display of the progress. None creates a display for this call.

    Returns:
        The reports of the episodes collected by this call, in order of completion.

    Raises:
        CollectError: If workers keep dying.
        StorageError: If the dataset's folder is removed or renamed during the collection; the folder is never created
            again.
        SvflError: If a collector raises one, which is passed on; episodes that were finished before are on disk.
    """
    info = dataset.info
    with ExitStack() as stack:
        held = stack.enter_context(dataset.writing())
        worker = Worker(
            collector, dataset.path, info["task"], info["seed"], info["config"], keep_failures, held.identity
        )
        if keep_failures:
            failures = Dataset.create_or_resume(dataset.path / FAILURES, info["task"], info["seed"], info["config"])
            stack.enter_context(failures.writing())
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
            held.check()  # a missing folder is the better explanation of a worker's error
            raise
        return done
