"""A dataset of format 1.0 becomes one of the present format, and nothing of it is lost."""

import dataclasses
import io
import json
import multiprocessing
import os
import shutil
import signal
import zipfile

import h5py
import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import entries
from svfl_data.errors import DatasetError, FormatError, StorageError, SvflError
from svfl_data.maintenance.pack import unpack
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.maintenance.upgrade import upgrade
from svfl_data.maintenance.version_1 import ADDED, PATHS
from svfl_data.recording.journal import HEADER
from svfl_data.sampling.split import load_split
from svfl_data.sampling.statistics import load_statistics
from svfl_data.schema.action_fields import ACTION, EXPERT_ACTION, expert, planar_action
from svfl_data.schema.episode import Episode
from svfl_data.storage.seal import SEAL_SIZE, seal
from svfl_data.storage.store import write_episode
from tests.helpers.version_1 import CONFIGS, SEALS, UNKNOWN, episode, version_1
from tests.hostile.journals import GOOD, journal, meta, record

FORK = multiprocessing.get_context("fork")


@pytest.fixture
def old(tmp_path):
    return Dataset.open(version_1(tmp_path / "old"))


@pytest.fixture(scope="module")
def upgraded(tmp_path_factory):
    place = tmp_path_factory.mktemp("upgraded")
    old = Dataset.open(version_1(place / "old"))
    return old, upgrade(old, place / "new"), Dataset.open(place / "new")


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def part_of(dataset, index):
    return Dataset.open(dataset.path / "failures") if index == 4 else dataset


def old_content(dataset, index):
    """The HDF5 content of an episode, which the examiner is not asked about: h5py reads it by itself."""
    extent = part_of(dataset, index).extent(index)
    return io.BytesIO(b"".join(extent.blocks())[:-SEAL_SIZE])


@pytest.mark.parametrize("index", range(5))
def test_every_array_and_attribute_is_what_the_old_file_holds(upgraded, index):
    old, _, new = upgraded
    found = part_of(new, index).read(index)
    with h5py.File(old_content(old, index)) as file:
        stored = {}
        file.visititems(lambda path, one: stored.update({path: one[()]}) if isinstance(one, h5py.Dataset) else None)
        attributes = dict(file.attrs)
    assert found.arrays.keys() == stored.keys() - {UNKNOWN}
    for path, array in found.arrays.items():
        assert array.dtype == np.asarray(stored[path]).dtype, path
        np.testing.assert_array_equal(array, stored[path], path)
    for key, value in dataclasses.asdict(found.meta).items():
        if key == "history":
            value = value[:-1]
        if key not in ADDED:
            assert value == (json.loads(attributes[key]) if isinstance(value, dict | list) else attributes[key]), key


@pytest.mark.parametrize("index", range(5))
def test_an_episode_is_what_was_given_to_the_old_code(upgraded, index):
    _, _, new = upgraded
    found = part_of(new, index).read(index)
    meta, arrays = episode(index)
    assert found.arrays.keys() == arrays.keys()
    for path, array in arrays.items():
        assert found.arrays[path].dtype == array.dtype
        if array.dtype.kind == "f":  # the sine of another processor may differ in its last digit
            np.testing.assert_allclose(found.arrays[path], array, rtol=1e-6, atol=1e-9, err_msg=path)
        else:
            np.testing.assert_array_equal(found.arrays[path], array, path)
    *history, last = found.meta.history
    robot = "panda_sim" if "world" in CONFIGS[index] else ""
    assert dataclasses.replace(found.meta, history=history) == dataclasses.replace(meta, robot=robot)
    assert (last["tool"], last["from_version"], last["seal"]) == ("svfl-data upgrade", "1.0", SEALS[index])
    assert last["left_out"] == ([UNKNOWN] if index == 1 else [])
    assert part_of(new, index).episode(index).format_version == "2.0"


def test_actions_are_bounded_by_what_the_configuration_declares(upgraded):
    _, _, new = upgraded
    own = {index: part_of(new, index).episode(index).declarations for index in range(5)}
    for index, action in ((1, planar_action(0.1, 0.5)), (2, planar_action(0.05, 0.25))):
        assert own[index].own == (action, expert(action))
    for index in (0, 4):
        action = dataclasses.replace(planar_action(), assumed=("bounds",))
        assert own[index].own == (action, expert(action))
    assert own[3].own == ()
    assert own[3].at(ACTION) == planar_action()
    assert own[3].at(EXPERT_ACTION) == expert(planar_action())


def test_places_splits_and_statistics_stay(upgraded):
    old, made, new = upgraded
    assert (made.episodes, made.current, made.left_out, made.others) == (5, 0, {UNKNOWN: 1}, [])
    assert new.info == old.info
    assert new.varies == {"workspace"}
    assert new.own_files().keys() == {0, 1}
    assert new.packed().keys() == {2, 3}
    with zipfile.ZipFile(new.path / "shard_000000.zip") as shard:
        assert shard.testzip() is None
        assert {info.compress_type for info in shard.infolist()} == {zipfile.ZIP_STORED}
    assert (new.path / "splits" / "default.json").read_bytes() == (old.path / "splits" / "default.json").read_bytes()
    split = load_split(new, "default")
    assert split.parts == load_split(old, "default").parts
    written = json.loads((old.path / "splits" / "default.statistics.json").read_text())["fields"]
    assert {path: dataclasses.asdict(one) for path, one in load_statistics(new, split).items()} == written
    assert [entry.error for entry in entries(new)] == [""] * 4


def test_statistics_that_were_stale_stay_stale(old, tmp_path):
    write_episode(Episode(*episode(0)), old.episode_path(0))  # relabelled, say
    upgrade(old, tmp_path / "new")
    new = Dataset.open(tmp_path / "new")
    with pytest.raises(DatasetError, match="changed since"):
        load_statistics(new, load_split(new, "default"))


def test_the_old_dataset_is_unchanged_and_twice_gives_the_same_bytes(old, tmp_path):
    before = contents(old.path)
    upgrade(old, tmp_path / "one")
    (tmp_path / "two").mkdir()
    upgrade(old, tmp_path / "two")
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert contents(old.path) == before


def test_episodes_that_were_recorded_since_are_copied_as_they_are(old, tmp_path):
    write_episode(Episode(*episode(1)), old.episode_path(7))
    made = upgrade(old, tmp_path / "new")
    assert (made.episodes, made.current) == (6, 1)
    assert Dataset.open(tmp_path / "new").episode_path(7).read_bytes() == old.episode_path(7).read_bytes()


def test_unfinished_recordings_become_episodes_of_the_new_dataset(old, tmp_path):
    (old.path / ".inflight").mkdir()
    first = record({"meta": {**meta(GOOD), "task": "centering"}})
    assert len(first) > HEADER.size
    (old.path / ".inflight" / f"episode_{GOOD:06d}.journal").write_bytes(journal(GOOD, first=first))
    (old.path / "README.md").write_text("my notes")
    made = upgrade(old, tmp_path / "new")
    assert (made.journals, made.others) == (1, ["README.md"])
    assert [action.done for action in repair_dataset(tmp_path / "new")] == ["salvaged"]
    assert Dataset.open(tmp_path / "new").read(GOOD).meta.index == GOOD


def changed(dataset, index, change):
    """Change an old episode with h5py, and seal it again, as anybody can."""
    path = dataset.episode_path(index)
    buffer = io.BytesIO(path.read_bytes()[:-SEAL_SIZE])
    with h5py.File(buffer, "r+") as file:
        change(file)
    path.write_bytes(buffer.getvalue() + seal(buffer.getvalue()))


def put(path, value):
    def change(file):
        attributes = dict(file[path].attrs) if path in file else {}
        if path in file:
            del file[path]
        file[path] = value
        file[path].attrs.update(attributes)

    return change


HOSTILE = {
    "unit": lambda file: file["streams/wrench/wrench"].attrs.__setitem__("unit", "lb"),
    "no unit": lambda file: file["workspace"].attrs.__delitem__("unit"),
    "array of later times": put("streams/later/more", np.array(["x"], dtype=object)),
    "not finite": put("streams/wrench/tare", np.full(6, np.nan)),
    "no rows": put("observations/t_ns", np.zeros(0, np.int64)),
    "no action": lambda file: file.__delitem__("actions"),
    "link": lambda file: file.__setitem__("extra/link", h5py.SoftLink("/workspace")),
    "elsewhere": lambda file: file.__setitem__("extra/link", h5py.ExternalLink("/etc/passwd", "/")),
    "no task": lambda file: file.attrs.__delitem__("task"),
    "no config": lambda file: file.attrs.__setitem__("config", "[]"),
    "version": lambda file: file.attrs.__setitem__("format_version", "3.0"),
    "format": lambda file: file.attrs.__setitem__("format", "mcap"),
    "huge": lambda file: file.create_dataset("extra/x", shape=(2**40,), chunks=(2**20,), dtype="u1", compression=1),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_file_that_is_none_is_one_line_and_nothing_is_left(old, tmp_path, command, kind):
    changed(old, 1, HOSTILE[kind])
    code, out, err = command("upgrade", old.path, tmp_path / "new")
    if kind == "array of later times":  # its kind matters to nobody
        assert (code, err) == (0, "")
        return
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert "episode_000001.hdf5" in err
    assert sorted(os.listdir(tmp_path)) == ["old"]


@pytest.mark.parametrize("where", ["file", "shard", "failures"])
def test_a_damaged_episode_is_one_line_and_nothing_is_left(old, tmp_path, command, where):
    file = {
        "file": old.episode_path(1),
        "shard": old.path / "shard_000000.zip",
        "failures": old.path / "failures" / "episode_000004.hdf5",
    }[where]
    content = bytearray(file.read_bytes())
    content[5000] ^= 1
    file.write_bytes(content)
    code, out, err = command("upgrade", old.path, tmp_path / "new")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert f"{file}" in err
    assert "damaged" in err
    assert sorted(os.listdir(tmp_path)) == ["old"]


def test_what_cannot_be_upgraded_is_said(old, tmp_path, command):
    for words, said in (
        ((old.path, old.path / "inside"), "inside"),
        ((old.path, old.path), "exists and is not empty"),
        ((tmp_path / "none", tmp_path / "new"), "no such folder"),
        ((old.episode_path(0), tmp_path / "new"), "is a file"),
    ):
        code, out, err = command("upgrade", *words)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert said in err
    assert command("upgrade", old.path, tmp_path / "new")[0] == 0
    code, out, err = command("upgrade", tmp_path / "new", tmp_path / "again")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "its 5 episodes are in format 2.0 already; there is nothing to upgrade" in err
    Dataset.create_or_resume(tmp_path / "empty", "centering", 0, {})
    assert "has no episodes" in command("upgrade", tmp_path / "empty", tmp_path / "again")[2]
    assert sorted(os.listdir(tmp_path)) == ["empty", "new", "old"]


def test_links_are_not_followed(old, tmp_path):
    shutil.rmtree(old.path / "splits")
    (tmp_path / "elsewhere").mkdir()
    (old.path / "splits").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FormatError, match="link"):
        upgrade(old, tmp_path / "new")
    assert sorted(os.listdir(tmp_path)) == ["elsewhere", "old"]


def test_a_kill_in_the_middle_leaves_no_dataset_and_the_next_call_clears_up(old, tmp_path, monkeypatch):
    before = contents(old.path)

    def work():
        written = []

        def write(path, content):
            written.append(path)
            if len(written) > 1:
                os.kill(os.getpid(), signal.SIGKILL)
            path.write_bytes(content)

        monkeypatch.setattr("svfl_data.maintenance.upgrade.write_atomically", write)
        upgrade(old, tmp_path / "new")

    process = FORK.Process(target=work)
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL
    (left,) = tmp_path.glob(".*.part")
    assert sorted(os.listdir(tmp_path)) == [left.name, "old"]
    upgrade(old, tmp_path / "new")
    assert sorted(os.listdir(tmp_path)) == ["new", "old"]
    assert contents(old.path) == before


def test_a_full_disk_leaves_nothing_and_is_one_line(disk, tmp_path):
    old = Dataset.open(version_1(tmp_path / "old"))
    disk.fill()
    with pytest.raises(StorageError, match="No space left") as caught:
        upgrade(old, disk.folder / "new")
    assert "\n" not in str(caught.value)
    assert not [name for name in os.listdir(disk.folder) if "new" in name]
    disk.empty()
    assert upgrade(old, disk.folder / "new").episodes == 5


def test_shards_can_be_unpacked_afterwards(upgraded, tmp_path):
    _, _, new = upgraded
    assert unpack(new, tmp_path / "unpacked").own_files().keys() == {0, 1, 2, 3}


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize(
    "words",
    [
        "info OLD", "info OLD --json", "info OLD --episode 2", "info FILE", "validate OLD", "validate OLD --json",
        "validate FILE", "plot OLD --out NEW.png", "topdown OLD --out NEW.png", "view OLD --out NEW.rrd",
        "view OLD --compare OLD --out NEW.rrd", "view FILE --out NEW.rrd", "card OLD", "card OLD --out NEW.md",
        "relabel OLD --episode 0 --success no", "relabel FILE --success no", "filter OLD NEW --success yes",
        "filter OLD NEW --valid", "merge OLD NEW", "pack OLD NEW", "unpack OLD NEW", "split OLD --split other",
        "split OLD --replace", "stats OLD", "repair OLD", "repair OLD --reseal",
    ],
)  # fmt: skip
def test_every_other_command_says_in_one_line_what_to_do(tmp_path, command, words, indexed):
    folder = version_1(tmp_path / "old", indexed)
    before = contents(tmp_path)
    names = {"OLD": folder, "FILE": folder / "episode_000000.hdf5"}
    arguments = [names.get(word, word.replace("NEW", str(tmp_path / "new"))) for word in words.split()]
    code, out, err = command(*arguments)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "format version 1.0; this software reads 2.x; svfl-data upgrade makes a new dataset of it" in err
    assert contents(tmp_path) == before
    assert sorted(os.listdir(tmp_path)) == ["old"]


def test_the_paths_of_1_0_are_standard_fields():
    from svfl_data.schema.fields import FIELDS

    assert {field.path for field in FIELDS} >= PATHS


def test_reading_an_old_dataset_is_an_error_that_programs_can_tell(old):
    for call in (lambda: old[0], lambda: entries(old), lambda: old.episode(0).meta, lambda: repair_dataset(old.path)):
        with pytest.raises(SvflError, match="svfl-data upgrade") as caught:
            call()
        assert type(caught.value).__name__ == "OldVersionError"
