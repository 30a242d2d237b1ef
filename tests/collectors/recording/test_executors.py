"""Worker processes: what they make does not depend on them, and a dead one costs nothing but time."""

import errno
import multiprocessing.synchronize
import os
from multiprocessing import popen_spawn_posix

import pytest

from collectors.recording.collection import collect_dataset
from collectors.recording.worker import FAILURES
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError, StorageError
from tests.helpers.collecting import contents
from tests.helpers.collectors import Made

pytestmark = pytest.mark.slow


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "data", "made", 0, {})


def test_a_process_that_dies_is_replaced_and_its_episode_redone(dataset, tmp_path, capfd):
    collector = Made(dies_at=1, dies_once=tmp_path / "died")
    done = collect_dataset(dataset, 5, 2, collector)
    assert sorted(finished.index for finished in done) == dataset.indices == [0, 1, 2, 3, 4]
    errors = capfd.readouterr().err
    assert errors.count("will be redone") == 1
    assert errors.count("\n") == 1
    whole = Dataset.create_or_resume(tmp_path / "whole", "made", 0, {})
    collect_dataset(whole, 5, 1, Made())
    assert contents(whole.path) == contents(dataset.path)


def test_processes_that_keep_dying_end_it(dataset, capfd):
    with pytest.raises(CollectError, match=r"3 times .* episode 2\b"):
        collect_dataset(dataset, 3, 1, Made(dies_at=2))
    assert dataset.indices == [0, 1]
    assert capfd.readouterr().err.count("will be redone") == 2


def test_a_collectors_error_ends_it_and_keeps_what_is_finished(dataset):
    with pytest.raises(CollectError, match="episode 2 cannot be made"):
        collect_dataset(dataset, 5, 1, Made(fails_at=2))
    assert {0, 1} <= set(dataset.indices)
    assert 2 not in dataset.indices


def test_no_process_is_one_line(dataset, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(popen_spawn_posix.Popen, "_launch", refuse)
    with pytest.raises(StorageError, match=os.strerror(errno.EAGAIN)):
        collect_dataset(dataset, 1, 1, Made())


def test_a_full_dev_shm_does_not_matter(dataset, monkeypatch):
    """Python keeps semaphores there, of which the workers need none."""

    def refuse(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(multiprocessing.synchronize.SemLock, "__init__", refuse)
    assert len(collect_dataset(dataset, 2, 2, Made())) == 2


def test_only_what_is_missing_is_collected(dataset):
    collect_dataset(dataset, 2, 1, Made())
    assert [finished.index for finished in collect_dataset(dataset, 3, 1, Made())] == [2]
    assert collect_dataset(dataset, 3, 1, Made(dies_at=0)) == []
    assert not (dataset.path / FAILURES).exists()


def test_a_dead_workers_leftovers_are_cleared(dataset, tmp_path):
    leftover = dataset.path / ".episode_000001.hdf5.abc.part"

    class Littering(Made):
        def __call__(self, index, **_):
            leftover.touch()
            return super().__call__(index)

    def here(indices, workers, worker):
        yield from map(worker.collect, indices)

    collect_dataset(dataset, 1, 1, Littering(), executor=here)
    assert dataset.indices == [0]
    assert not leftover.exists()
