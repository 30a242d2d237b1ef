"""Nothing in a dataset folder is read or written through a link, nothing waits for a pipe, names have one meaning."""

import os
import re
import shutil
import signal

import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance.pack import pack
from svfl_data.sampling.split import split_episodes
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode

pytestmark = pytest.mark.slow

COMMANDS = (
    ("info",), ("validate",), ("merge", "NEW"), ("filter", "NEW", "--success", "yes"), ("stats",), ("pack", "NEW"),
    ("split", "--split", "default", "--seed", "5"), ("relabel", "--contact"), ("card",), ("repair",),
)  # fmt: skip


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    for index in range(4):
        write_episode(make_episode(index), dataset.episode_path(index))
    split_episodes(dataset.indices, {"train": 0.5, "test": 0.5}, seed=0).save(dataset)
    return dataset


@pytest.fixture
def run(command, tmp_path):
    """Run a command; one that waits for ever is ended."""

    def ended(*_):
        raise AssertionError("the command waits")

    before = signal.signal(signal.SIGALRM, ended)
    signal.alarm(300)
    yield lambda name, path, *words: command(name, path, *(tmp_path / "new" if one == "NEW" else one for one in words))
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def make(kind, path, tmp_path):
    """Put something in the place of a file."""
    outside = tmp_path / "outside"
    outside.write_bytes(path.read_bytes() if path.is_file() else b"")
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    if kind == "link":
        path.symlink_to(outside)
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    elif kind == "dangling":
        path.symlink_to(tmp_path / "made")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    return outside


@pytest.mark.parametrize("name", ["dataset.json", "index.jsonl", "episode_000001.hdf5", "splits/default.json"])
@pytest.mark.parametrize("kind", ["link", "endless", "dangling", "pipe", "folder"])
def test_what_is_no_ordinary_file_is_refused_at_once(dataset, tmp_path, run, name, kind):
    outside = make(kind, dataset.path / name, tmp_path)
    before = outside.read_bytes()
    readers = {"splits/default.json": ("stats",), "episode_000001.hdf5": ("filter", "NEW", "--success", "yes")}
    reader, *options = readers.get(name, ("info",))
    code, _, err = run(reader, dataset.path, *options)
    assert code == 1
    assert err.startswith("svfl-data: ")
    assert err.count("\n") == 1
    assert name.rpartition("/")[2] in err
    assert outside.read_bytes() == before
    assert not (tmp_path / "made").exists()
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("command_line", COMMANDS, ids=lambda words: words[0])
def test_no_command_writes_through_a_link(dataset, tmp_path, run, command_line):
    """Every file and folder that commands write in a dataset leads outside."""
    outside = tmp_path / "outside"
    outside.mkdir()
    for name in (".inflight", "splits", "damaged", "README_files"):
        shutil.rmtree(dataset.path / name, ignore_errors=True)
        (dataset.path / name).symlink_to(outside)
    for name in ("index.jsonl", "README.md"):
        (dataset.path / name).unlink(missing_ok=True)
        (dataset.path / name).symlink_to(outside / name)
    if command_line[0] == "repair":
        dataset.episode_path(2).write_bytes(b"damaged")
    code, _, err = run(command_line[0], dataset.path, *command_line[1:])
    assert code in (0, 1)
    assert err.count("\n") == code
    assert list(outside.iterdir()) == []


def test_the_folder_itself_may_be_a_link(dataset, tmp_path, run):
    (tmp_path / "named").symlink_to(dataset.path)
    assert run("info", tmp_path / "named")[0] == 0
    assert run("merge", tmp_path / "named", "NEW")[0] == 0


LOOKALIKES = (
    "episode_3.hdf5", "episode_00000003.hdf5", "Episode_000003.hdf5", "episode_000003.h5", "episode_000003 (1).hdf5",
    "episode_٠٠٠٠٠٣.hdf5",
)  # fmt: skip


def test_which_episodes_exist_has_one_answer(dataset, tmp_path, command):
    """Files that only look like episodes are counted by nobody, and named."""
    for name in LOOKALIKES:
        shutil.copy(dataset.episode_path(3), dataset.path / name)
    assert dataset.indices == [0, 1, 2, 3]
    assert sorted(dataset.strays()) == sorted(LOOKALIKES)
    out = command("info", dataset.path)[1]
    assert "4 episodes" in out
    assert all(f"{name}: not counted" in out for name in LOOKALIKES)
    code, out, _ = command("validate", dataset.path)
    assert code == 0
    assert "not counted as episodes" in out
    assert "in 4 episodes" in command("info", dataset.path)[1] or "4 episodes" in out
    assert command("merge", dataset.path, tmp_path / "m")[1].endswith("4 episodes from 1 datasets\n")
    assert command("filter", dataset.path, tmp_path / "f", "--success", "yes")[1].endswith("f: 4 episodes\n")
    assert len(pack(dataset, tmp_path / "p")) == 4


def test_a_million_episodes_and_more_have_names(dataset):
    name = dataset.file_name(1_234_567)
    write_episode(make_episode(1_234_567), dataset.path / name)
    assert name == "episode_1234567.hdf5"
    assert dataset.indices == [0, 1, 2, 3, 1_234_567]
    (dataset.path / "episode_0234567.hdf5").touch()
    assert dataset.strays() == ["episode_0234567.hdf5"]


@pytest.mark.parametrize("relabelled", [False, True])
def test_the_same_recording_twice_is_found_and_never_split(dataset, tmp_path, command, relabelled):
    shutil.copy(dataset.episode_path(3), dataset.episode_path(9))
    if relabelled:
        command("relabel", dataset.path, "--episode", 9, "--success", "no")
    code, out, _ = command("validate", dataset.path)
    assert code == 1
    assert re.search(rf"{dataset.episode_path(9)}: .*episode_000003\.hdf5", out)
    for words in (
        ("merge", dataset.path, tmp_path / "m"),
        ("filter", dataset.path, tmp_path / "m", "--task", "centering"),
        ("split", dataset.path, "--split", "new"),
    ):
        code, _, err = command(*words)
        assert (code, err.count("\n")) == (1, 1)
        assert re.search(r"9(\.hdf5)? of \S*3\b.*--once", err)
    assert "1 copy left out" in command("filter", dataset.path, tmp_path / "m", "--once")[1]
    assert len(Dataset.open(tmp_path / "m")) == 4
    assert command("split", tmp_path / "m", "--ratios", "train=0.5", "test=0.5")[0] == 0


def test_a_relabelled_episode_in_front_of_its_shard_is_no_copy(dataset, tmp_path, command):
    packed = pack(dataset, tmp_path / "packed")
    command("relabel", packed.path, "--episode", 3, "--success", "no")
    assert packed.indices == [0, 1, 2, 3]
    assert not packed.read(3).meta.success
    assert command("validate", packed.path)[0] == 0
    assert command("merge", packed.path, tmp_path / "m")[0] == 0


def test_of_two_shards_with_one_episode_the_later_is_read_and_that_is_said(dataset, tmp_path, command):
    packed = pack(dataset, tmp_path / "packed")
    again = Dataset.create_or_resume(tmp_path / "again", "centering", 0, {})
    write_episode(make_episode(3, steps=9), again.episode_path(3))
    shutil.copy(pack(again, tmp_path / "again_packed").path / "shard_000000.zip", packed.path / "shard_000001.zip")
    assert len(packed.read(3)) == 9
    assert packed.indices == [0, 1, 2, 3]
    code, out, _ = command("validate", packed.path)
    assert code == 0
    assert "in more than one shard" in out
    assert re.search(r"\b3\b.*shard_000000\.zip.*shard_000001\.zip", out)


def test_shards_of_any_name_can_be_packed_again(dataset, tmp_path, command):
    packed = pack(dataset, tmp_path / "packed")
    os.rename(packed.path / "shard_000000.zip", packed.path / "shard_old.zip")
    write_episode(make_episode(8), dataset.episode_path(8))
    assert command("pack", dataset.path, packed.path)[0] == 0
    assert packed.indices == [0, 1, 2, 3, 8]


def test_a_split_whose_episodes_are_gone_says_which_and_how_to_go_on(dataset, command):
    assert command("stats", dataset.path)[0] == 0
    dataset.episode_path(2).unlink()
    for words in (("stats", dataset.path), ("split", dataset.path, "--ratios", "train=0.5", "test=0.5")):
        code, _, err = command(*words)
        assert (code, err.count("\n")) == (1, 1)
        assert re.search(r"\b1 of its 4 episodes.*\b2\b", err)
        assert "--replace" in err
    assert command("split", dataset.path, "--ratios", "train=0.5", "test=0.5", "--replace")[0] == 0
    assert command("stats", dataset.path)[0] == 0
    assert command("split", dataset.path, "--split", "other", "--ratios", "train=0.5", "test=0.5")[0] == 0


@pytest.mark.slow
def test_a_split_of_all_episodes_gone_names_only_some(dataset, command):
    for index in range(4, 40):
        write_episode(make_episode(index, steps=1), dataset.episode_path(index))
    command("split", dataset.path, "--split", "many")
    for index in range(40):
        dataset.episode_path(index).unlink()
    code, _, err = command("stats", dataset.path, "--split", "many")
    assert code == 1
    assert "and 35 more" in err
