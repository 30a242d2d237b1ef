"""Whatever an operating system refuses while recording is one line of ours that says where; nothing is lost by it."""

import errno
import fcntl
import os
import threading

import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import StorageError
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.storage.store import episode_bytes
from tests.helpers.builders import make_episode
from tests.helpers.recording import append_all, start

pytestmark = pytest.mark.slow

ERRORS = [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ESTALE, errno.ENOLCK, errno.EIO]


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "recorded", "centering", 0, {})


def refusing(number: int):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return refuse


def one_line(error: pytest.ExceptionInfo, dataset: Dataset, number: int) -> None:
    assert str(dataset.path) in str(error.value)
    assert os.strerror(number) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("number", ERRORS)
def test_locking(dataset, monkeypatch, number):
    with monkeypatch.context() as patched:
        patched.setattr(fcntl, "flock", refusing(number))
        with pytest.raises(StorageError) as error, dataset.writing():
            pass
        one_line(error, dataset, number)
        with pytest.raises(StorageError) as error:
            start(dataset)
        one_line(error, dataset, number)
    start(dataset).discard()
    assert list((dataset.path / ".inflight").iterdir()) == []


@pytest.mark.parametrize("number", ERRORS)
@pytest.mark.parametrize("call", ["pwrite", "ftruncate", "fsync", "pread", "statvfs", "link"])
def test_recording_and_sealing(dataset, monkeypatch, number, call):
    """Whichever call it is that is refused, besides writing itself where that alone fails nothing."""
    episode = make_episode()
    with start(dataset, episode, flush_s=0.0) as writer:
        append_all(writer, episode.arrays)
        with monkeypatch.context() as patched:
            patched.setattr(os, call, refusing(number))
            if call in ("ftruncate", "statvfs"):
                patched.setattr(os, "pwrite", refusing(number))
                patched.setattr(os, "fstatvfs", refusing(number))
            with pytest.raises(StorageError) as error:
                writer.seal()
            one_line(error, dataset, number)
        assert writer.seal().read_bytes() == episode_bytes(episode)


@pytest.mark.parametrize("number", ERRORS)
def test_syncing_in_the_background(dataset, monkeypatch, number):
    synced = threading.Event()

    def refuse(*_: object) -> None:
        synced.set()
        raise OSError(number, os.strerror(number))

    episode = make_episode()
    with start(dataset, episode, flush_s=0.0, sync_s=0.0) as writer:
        monkeypatch.setattr(os, "fdatasync", refuse)
        writer.flush()
        synced.wait()
        writer._journal._sync.exception()
        with pytest.raises(StorageError) as error:
            writer.flush()
        one_line(error, dataset, number)
        writer.discard()


@pytest.mark.parametrize("number", ERRORS)
def test_a_journal_that_cannot_be_locked_is_left_alone(dataset, monkeypatch, number):
    """Its writer may live: on such a file system nobody can tell."""
    episode = make_episode()
    with start(dataset, episode) as writer:
        append_all(writer, episode.arrays)
    with monkeypatch.context() as patched:
        patched.setattr(fcntl, "flock", refusing(number))
        (action,) = repair_dataset(dataset.path)
    assert action.done == "left alone"
    assert os.strerror(number) in action.detail
    (action,) = repair_dataset(dataset.path)
    assert action.done == "salvaged"
