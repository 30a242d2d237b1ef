"""Executor that runs workers as processes of this machine."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from collectors.recording.worker import Collected, Deaths, Worker
from svfl_data.system.worker_processes import Died, run_jobs


def run(indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
    """Collect episodes with processes; see `collectors.recording.worker.Executor`.

    When the collection ends early, episodes that have been started are finished.

    Args:
        indices: Indices of the episodes to collect.
        workers: Number of processes that run at a time.
        worker: Worker that each process runs.

    Yields:
        The report of each episode that is finished and on disk, in order of completion.

    Raises:
        CollectError: If workers keep dying.
        StorageError: If no worker process can be started.
        SvflError: If a collector raises one, which is passed on.
    """
    waiting, deaths = deque(indices), Deaths()
    for index, collected in run_jobs(partial(_prepare, worker), waiting, workers):
        if isinstance(collected, Died):
            deaths.count("a worker process", [index])
            waiting.appendleft(index)
        else:
            deaths.forget()
            yield collected


def _prepare(worker: Worker, place: int) -> Callable[[int], Collected]:
    """Return what collects the episode of an index in this process."""
    return worker.collect
