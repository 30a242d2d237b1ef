"""A process forked while an episode is recorded can neither add to it nor harm it, however it ends."""

import copy
import multiprocessing
import os
import pickle
import signal

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, UsageError
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.storage.store import episode_bytes
from tests.helpers.builders import make_episode
from tests.helpers.child import fork, in_child
from tests.helpers.recording import append_all, start

pytestmark = pytest.mark.slow

REFUSED, OTHER = 7, 8


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "recorded", "centering", 0, {})


USES = {
    "append": lambda writer: writer.append("actions", action=np.zeros((1, 5), np.float32)),
    "gap": lambda writer: writer.gap("streams/wrench", 0, None, "x"),
    "flush": lambda writer: writer.flush(),
    "seal": lambda writer: writer.seal(),
    "seal_beside": lambda writer: writer.seal_beside(),
    "discard": lambda writer: writer.discard(),
    "journal": lambda writer: writer._journal.append({"fault": "x"}),
    "journal's sync": lambda writer: writer._journal.sync(),
    "what waits": lambda writer: writer._behind.flush(),
}


def refusal(use, writer) -> int:
    try:
        use(writer)
    except UsageError as error:
        return REFUSED if f"process {os.getppid()} " in str(error) and "\n" not in str(error) else OTHER
    return OTHER


@pytest.mark.parametrize("use", USES.values(), ids=USES.keys())
@pytest.mark.parametrize("waiting", [True, False])
def test_every_use_in_a_fork_is_refused_and_harms_nothing(dataset, use, waiting):
    episode = make_episode()
    with start(dataset, episode, flush_s=100.0) as writer:
        append_all(writer, episode.arrays, rng=np.random.default_rng(3))
        if not waiting:
            writer.flush()
        assert in_child(lambda: refusal(use, writer)) == REFUSED
        assert writer.seal().read_bytes() == episode_bytes(episode)


def leave_by_exception(writer: EpisodeWriter) -> None:
    with writer:
        raise RuntimeError


def leave_block(writer: EpisodeWriter) -> None:
    with writer:
        pass


@pytest.mark.parametrize(
    "end", [lambda _: None, leave_block, leave_by_exception, lambda _: os.kill(os.getpid(), signal.SIGKILL)],
    ids=["returns", "leaves the block", "raises", "is killed"],
)  # fmt: skip
@pytest.mark.parametrize("how", ["fork", "multiprocessing"])
def test_a_fork_that_ends_harms_nothing(dataset, end, how):
    episode = make_episode()
    with start(dataset, episode, flush_s=100.0) as writer, dataset.writing():
        append_all(writer, episode.arrays)
        if how == "fork":
            in_child(lambda: end(writer) or 0)
        else:
            process = multiprocessing.get_context("fork").Process(target=end, args=(writer,))
            process.start()
            process.join()
        with pytest.raises(DatasetError, match="another process"), Dataset.open(dataset.path).writing():
            pass
        assert writer.seal().read_bytes() == episode_bytes(episode)


def test_a_fork_that_leaves_the_block_of_a_collection_clears_nothing_away(dataset):
    hold = dataset.writing()
    hold.__enter__()
    living = dataset.path / ".episode_000000.hdf5.abc.part"
    living.write_bytes(b"being written")
    assert in_child(lambda: int(bool(hold.__exit__(None, None, None)))) == 0
    assert living.exists()
    hold.__exit__(None, None, None)
    assert not living.exists()


def test_a_fork_that_outlives_the_writer_does_not_keep_repair_away(dataset):
    """The kernel's lock tells a living writer from a dead one; a helper process that was forked must not hold it."""
    told, go = os.pipe(), os.pipe()

    def outlive() -> int:
        os.write(told[1], b"x")
        os.read(go[0], 1)
        return 0

    def record_and_die() -> int:
        with start(dataset, flush_s=0.0) as writer, dataset.writing():
            append_all(writer, make_episode().arrays)
            fork(outlive)
            os.read(told[0], 1)
            os.kill(os.getpid(), signal.SIGKILL)
        return 0

    assert in_child(record_and_die) == -signal.SIGKILL
    try:
        (action,) = repair_dataset(dataset.path)
        with dataset.writing():
            pass
    finally:
        os.write(go[1], b"x")
    assert action.done == "salvaged"


@pytest.mark.parametrize("carry", [pickle.dumps, copy.copy, copy.deepcopy])
def test_a_writer_is_neither_pickled_nor_copied(dataset, carry):
    with start(dataset) as writer:
        for owner in (writer, writer._journal, writer._behind, writer._folder):
            with pytest.raises(UsageError, match=f"{type(owner).__name__}.*process {os.getpid()} "):
                carry(owner)
        writer.discard()


def test_a_spawned_process_cannot_take_it_along(dataset):
    with start(dataset) as writer:
        process = multiprocessing.get_context("spawn").Process(target=leave_block, args=(writer,))
        with pytest.raises(UsageError, match=rf"EpisodeWriter.*process {os.getpid()} .*multiprocessing\.Queue"):
            process.start()
        writer.discard()
