"""Two at once lose nothing, and what killed ones have left is told from what living ones are writing."""

import multiprocessing
import os
import signal

import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import StorageError
from svfl_data.maintenance.merge import merge
from svfl_data.maintenance.pack import pack
from svfl_data.maintenance.relabel import relabel, relabel_file, with_annotation
from svfl_data.storage.store import write_episode
from svfl_data.system.atomic_io import write_atomically, written_aside
from svfl_data.system.leftovers import clear_files, clear_folders, folder_aside
from tests.helpers.builders import make_episode

pytestmark = pytest.mark.slow

FORK = multiprocessing.get_context("fork")


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    for index in range(2):
        write_episode(make_episode(index, steps=2), dataset.episode_path(index))
    return dataset


def together(work, number):
    """Processes that begin at the same moment; their exit codes."""
    barrier = FORK.Barrier(number)

    def begin(mine):
        barrier.wait(60)
        work(mine)

    processes = [FORK.Process(target=begin, args=(mine,)) for mine in range(number)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(120)
    return [process.exitcode for process in processes]


def annotate_often(change, mine):
    for turn in range(5):
        change(with_annotation(f"mark_{mine}_{turn}", 0.0, 0.01))


@pytest.mark.parametrize("kind", ["own file", "shard", "by file"])
def test_thirty_relabels_at_once_are_all_kept(dataset, tmp_path, kind):
    where = pack(dataset, tmp_path / "packed") if kind == "shard" else dataset

    def work(mine):
        if kind == "by file":
            annotate_often(lambda change: relabel_file(where.episode_path(1), change), mine)
        else:
            annotate_often(lambda change: relabel(where, 1, change), mine)

    assert together(work, 6) == [0] * 6
    episode = where.read(1)
    assert {one["name"] for one in episode.meta.annotations} == {f"mark_{i}_{k}" for i in range(6) for k in range(5)}
    assert len(episode.meta.history) == 30
    assert not list(where.path.glob(".*"))


def test_a_starting_collector_leaves_living_writers_alone(dataset):
    """One half relabels, the other half begins and ends collecting, which clears away what killed ones have left."""

    def work(mine):
        for turn in range(8):
            if mine % 2:
                relabel(dataset, mine // 2, with_annotation(f"mark_{mine}_{turn}", 0.0, 0.01))
            else:
                dataset.clear()

    assert together(work, 4) == [0] * 4
    assert [len(dataset.read(index).meta.annotations) for index in (0, 1)] == [8, 8]


def test_what_is_being_written_is_no_leftover(tmp_path):
    with written_aside(tmp_path / "file") as file:
        file.write(b"whole")
        clear_files(tmp_path)
    assert (tmp_path / "file").read_bytes() == b"whole"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_only_leftovers_are_cleared(tmp_path):
    for name in (".episode_000001.hdf5.abc.part", ".x.part"):
        (tmp_path / name).write_bytes(b"half")
    kept = {"notes.part", ".hidden", ".old.part.txt"}
    for name in kept:
        (tmp_path / name).write_bytes(b"mine")
    (tmp_path / ".mine.abc.part").mkdir()
    (tmp_path / ".link.part").symlink_to(tmp_path / ".hidden")
    clear_files(tmp_path)
    clear_folders(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept | {".mine.abc.part", ".link.part"}


def killed(work):
    """Do a work in a process that is killed in the middle of it, where it calls what it is given."""

    def die():
        os.kill(os.getpid(), signal.SIGKILL)

    process = FORK.Process(target=work, args=(die,))
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL


def test_the_remains_of_a_killed_merge_go_with_the_next_one(dataset, tmp_path, monkeypatch):
    def work(die):
        monkeypatch.setattr("svfl_data.maintenance.merge.write_episode", lambda *_: die())
        merge([dataset], tmp_path / "merged")

    killed(work)
    (left,) = tmp_path.glob(".*.part")
    assert left.is_dir()
    with folder_aside(tmp_path / "other") as living:
        merge([dataset], tmp_path / "another")
        assert not left.exists()
        assert living.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["another", "d"]


def test_the_remains_of_a_killed_write_go_with_the_next_command(dataset, monkeypatch, command):
    def work(die):
        monkeypatch.setattr("os.fsync", lambda _: die())
        write_atomically(dataset.episode_path(7), b"half")

    killed(work)
    assert len(list(dataset.path.glob(".*.part"))) == 1
    assert command("relabel", dataset.path, "--episode", 1, "--success", "no")[0] == 0
    assert not list(dataset.path.glob(".*.part"))


def fails(*_args, **_kwargs):
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize(
    "words",
    [
        ("merge", "SRC", "NEW"),
        ("filter", "SRC", "NEW", "--success", "yes"),
        ("pack", "SRC", "NEW"),
        ("split", "SRC", "--ratios", "train=0.5", "test=0.5"),
    ],
)
def test_a_command_that_failed_can_be_given_again(dataset, tmp_path, command, monkeypatch, words):
    """A full disk at any of its first writes leaves nothing locked and nothing in the way."""
    arguments = [{"SRC": dataset.path, "NEW": tmp_path / "new"}.get(word, word) for word in words]
    real, count = os.fsync, 0
    for good in range(3):
        left = good

        def sync(descriptor):
            nonlocal left, count
            left, count = left - 1, count + 1
            return real(descriptor) if left >= 0 else fails()

        monkeypatch.setattr("os.fsync", sync)
        code, _, err = command(*arguments)
        if code:
            assert (code, err.count("\n")) == (1, 1)
            assert "No space left on device" in err
        assert not list(tmp_path.glob(".*"))
    assert count
    monkeypatch.setattr("os.fsync", real)
    if (tmp_path / "new").exists() and words[0] in ("merge", "filter"):
        return  # it had been made before the disk was full
    assert command(*arguments)[0] == 0


def test_a_disk_that_refuses_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("os.replace", fails)
    with pytest.raises(StorageError, match=f"{tmp_path / 'file'}.*No space left"):
        write_atomically(tmp_path / "file", b"whole")
    assert not list(tmp_path.iterdir())
