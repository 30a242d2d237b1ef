"""Worker processes of this machine."""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from collectors.recording.worker import SHARED_MEMORY, Collected, Deaths, Worker
from svfl_data.errors import StorageError

_worker: Worker  # of this worker process


def run(indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
    """Collect with processes; see `collectors.recording.worker.Executor`."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # workers inherit it: one core each, and sums in one order
    waiting = deque(indices)
    deaths = Deaths()
    while waiting:
        # One process dying takes its whole pool with it: what was not finished goes to a new pool.
        unfinished: set[int] = set()
        yield from _pool(waiting, unfinished, workers, worker, deaths)
        if unfinished:
            deaths.count("a worker process", sorted(unfinished))
            waiting.extendleft(sorted(unfinished, reverse=True))


def _pool(
    waiting: deque[int], unfinished: set[int], workers: int, worker: Worker, deaths: Deaths
) -> Iterator[Collected]:
    """Collect until nothing waits, or a process dies: then `unfinished` are the indices that were being worked on."""
    try:
        # Fresh processes: a forked one would inherit the parent's threads and locks.
        pool = ProcessPoolExecutor(
            min(workers, len(waiting)), multiprocessing.get_context("spawn"), _start_worker, (worker,)
        )
    except OSError as error:
        raise StorageError(f"no worker process can be started: {error.strerror}; {SHARED_MEMORY}") from error
    running: dict[Future[Collected], int] = {}
    try:
        while waiting or running:
            # A short queue: what is not started yet is what Ctrl-C need not wait for.
            while waiting and len(running) < 2 * workers:
                index = waiting.popleft()
                unfinished.add(index)
                running[pool.submit(_collect, index)] = index
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in sorted(finished, key=running.__getitem__):
                collected = future.result()
                unfinished.remove(running.pop(future))
                deaths.forget()
                yield collected
    except BrokenProcessPool:
        pass
    finally:
        pool.shutdown(cancel_futures=True)


def _start_worker(worker: Worker) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle; a started episode is finished
    _worker = worker


def _collect(index: int) -> Collected:
    return _worker.collect(index)
