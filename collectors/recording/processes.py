"""Collecting with worker processes of this machine."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from collectors.recording.worker import Collected, Deaths, Worker
from svfl_data.system.worker_processes import Died, run_jobs


def run(indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
    """Collect episodes with processes; see `collectors.recording.worker.Executor`.

    When the collection ends early, episodes that have been started are finished.
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
