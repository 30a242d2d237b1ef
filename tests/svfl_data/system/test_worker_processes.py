"""Worker processes: every job is done once, errors and deaths are told, and nobody is left behind."""

import multiprocessing
import os
import signal
import threading
import time
from collections import deque

import pytest

from svfl_data.errors import DatasetError
from svfl_data.system.worker_processes import Died, run_jobs

pytestmark = pytest.mark.slow


def doubling(place):
    return lambda job: 2 * job


def naming_places(place):
    return lambda job: place


def dividing(place):
    return lambda job: 1 / job


def refusing(place):
    raise DatasetError(f"place {place} is not ready")


def refusing_jobs(place):
    def do(job):
        raise DatasetError(f"no job {job}")

    return do


def killing(place):
    def do(job):
        if job == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return job

    return do


def making_locks(place):
    return lambda job: threading.Lock()


def sleeping(place):
    return time.sleep


@pytest.fixture(autouse=True)
def _nobody_is_left():
    yield
    assert multiprocessing.active_children() == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("workers", [1, 2, 9])
def test_every_job_is_done_once(workers):
    assert sorted(run_jobs(doubling, deque(range(7)), workers)) == [(job, 2 * job) for job in range(7)]


def test_nothing_to_do_is_nothing():
    assert list(run_jobs(doubling, deque(), 2)) == []


def test_jobs_may_be_added_meanwhile():
    waiting = deque([3])
    done = []
    for job, result in run_jobs(doubling, waiting, 2):
        done.append(result)
        if job > 0:
            waiting.append(job - 1)
    assert done == [6, 4, 2, 0]


def test_no_more_processes_than_jobs():
    assert {place for _, place in run_jobs(naming_places, deque(range(2)), 30)} <= {0, 1}


def test_one_that_dies_is_told_and_replaced():
    outcomes = dict(run_jobs(killing, deque(range(4)), 1))
    assert outcomes == {0: 0, 1: Died(-signal.SIGKILL), 2: 2, 3: 3}


@pytest.mark.parametrize(("prepare", "words"), [(refusing, "place 0 is not ready"), (refusing_jobs, "no job 5")])
def test_our_errors_arrive_as_they_are(prepare, words):
    with pytest.raises(DatasetError, match=words):
        list(run_jobs(prepare, deque([5]), 1))


def test_a_mistake_says_where_it_was_made():
    with pytest.raises(ZeroDivisionError) as raised:
        list(run_jobs(dividing, deque([0]), 1))
    assert "return lambda job: 1 / job" in "".join(raised.value.__notes__)


def test_an_answer_that_cannot_be_sent_is_an_error():
    with pytest.raises(RuntimeError, match=r"answer.*_thread\.lock"):
        list(run_jobs(making_locks, deque([1]), 1))


def test_a_caller_that_stops_waits_for_nobody_if_so_wished():
    jobs = run_jobs(sleeping, deque([0, 3600]), 2, finish=False)
    assert next(jobs) == (0, None)
    jobs.close()


def test_from_a_thread():
    """A signal's handler can be set in the main thread only."""
    found = []
    thread = threading.Thread(target=lambda: found.extend(run_jobs(doubling, deque([4]), 1)))
    thread.start()
    thread.join()
    assert found == [(4, 8)]
