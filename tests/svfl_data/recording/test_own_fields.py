"""What is promised of the standard fields holds for those that nobody knows: bytes, journals, kills, damage."""

import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from svfl_data.checks import check_dataset
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, FormatError, StorageError, SvflError, UsageError
from svfl_data.maintenance.merge import merge
from svfl_data.maintenance.relabel import relabel, with_annotation
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.sampling.statistics import compute_statistics
from svfl_data.schema.action_fields import pose_action
from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.field import Field
from svfl_data.storage.reader import EpisodeReader
from svfl_data.storage.store import episode_bytes, read_episode, write_episode
from tests.helpers.child import exit_code, fork
from tests.helpers.own_robot import FIELDS, TACTILE, own_dataset, own_episode

OWN = Declarations(FIELDS)
CUTS = 60


@pytest.fixture
def dataset(tmp_path):
    return Dataset.create_or_resume(tmp_path / "mine", "wiping", 0, {})


def groups(arrays):
    found: dict[str, dict[str, np.ndarray]] = {}
    for path, array in arrays.items():
        if OWN.at(path).grows:
            group, _, name = path.rpartition("/")
            found.setdefault(group, {})[name] = array
    return found


def begin(dataset, episode, fields=FIELDS, **options):
    constants = {path: array for path, array in episode.arrays.items() if not OWN.at(path).grows}
    meta = replace(episode.meta, index=NEXT)
    return EpisodeWriter(dataset, meta, constants, fields, rates_hz=episode.meta.config["rates_hz"], **options)


def append(writer, arrays, pieces=5):
    """In turns, as sensors do."""
    for piece in range(pieces):
        for group, columns in groups(arrays).items():
            rows = len(next(iter(columns.values())))
            part = slice(rows * piece // pieces, rows * (piece + 1) // pieces)
            if part.stop > part.start:
                writer.append(group, **{name: array[part] for name, array in columns.items()})


def assert_prefix(found, truth):
    for path, array in found.items():
        expected = truth[path][: len(array)] if array.ndim else truth[path]
        np.testing.assert_array_equal(array, expected, err_msg=path)


def test_a_writer_gives_the_bytes_of_the_whole_episode_and_reading_gives_it_back(dataset):
    episode = own_episode(0)
    with begin(dataset, episode) as writer:
        append(writer, episode.arrays)
        path = writer.seal(success=True)
    assert path.read_bytes() == episode_bytes(episode)
    read = read_episode(path)
    assert read.declarations == OWN
    assert read.meta == episode.meta
    assert read.arrays.keys() == episode.arrays.keys()
    assert_prefix(read.arrays, episode.arrays)
    assert EpisodeReader.of_file(path)["streams/tactile/pressure"].unit == "kPa"


def test_a_journal_cut_anywhere_gives_back_what_was_before(dataset):
    episode = own_episode(0, steps=12)
    with begin(dataset, episode, flush_s=0.0) as writer:
        append(writer, episode.arrays, pieces=12)
        journal = writer._journal.path
    whole, salvaged = journal.read_bytes(), 0
    for position in np.linspace(0, len(whole) - 1, CUTS).astype(int):
        journal.write_bytes(whole[:position])
        (action,) = repair_dataset(dataset.path)
        if action.done == "salvaged":
            saved = read_episode(action.path)
            assert set(saved.declarations.own) <= set(OWN.own)
            assert_prefix(saved.arrays, episode.arrays)
            salvaged += "streams/tactile/pressure" in saved.arrays
        action.path.unlink()
    assert salvaged > CUTS / 2


def test_a_killed_recording_loses_nothing_that_was_flushed(dataset):
    episode, rng = own_episode(0, steps=40), np.random.default_rng(0)
    for attempt in range(6):

        def record_slowly() -> int:
            with begin(dataset, episode, flush_s=0.0) as writer:
                append(writer, episode.arrays, pieces=40)
                time.sleep(60)
            return 0

        child = fork(record_slowly)
        time.sleep(float(rng.uniform(0.1, 0.6)))
        os.kill(child, signal.SIGKILL)
        assert exit_code(child) == -signal.SIGKILL
        for action in repair_dataset(dataset.path):
            if action.done == "salvaged":
                saved = read_episode(action.path)
                assert_prefix(saved.arrays, episode.arrays)
                assert not saved.meta.success
        assert list(dataset.path.glob(".inflight/*.journal")) == [], attempt


def test_a_flipped_bit_anywhere_is_found(dataset):
    whole, rng = episode_bytes(own_episode(0)), np.random.default_rng(1)
    file = dataset.episode_path(0)
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        with pytest.raises(FormatError, match=file.name):
            read_episode(file)


def test_a_full_disk_is_one_line_and_the_readings_stay(dataset, monkeypatch):
    import svfl_data.recording.writer as module

    def full(*_):
        raise StorageError("cannot write: No space left on device")

    episode = own_episode(0)
    with begin(dataset, episode) as writer:
        append(writer, episode.arrays)
        with monkeypatch.context() as patched:
            patched.setattr(module, "build", full)
            with pytest.raises(StorageError, match="No space left"):
                writer.seal()
        assert writer.seal().read_bytes() == episode_bytes(episode)


SPOILED = {
    "not declared": ("streams/heat/celsius", np.zeros(1), "streams/heat/.*not declared"),
    "dtype": ("streams/tactile/pressure", np.zeros((1, 2, 4, 4)), "pressure.*float64.*float32"),
    "shape": ("streams/tactile/pressure", np.zeros((1, 2, 4, 5), np.float32), r"\(1, 2, 4, 5\).*\(T, 2, 4, 4\)"),
    "NaN": ("streams/tactile/pressure", np.full((1, 2, 4, 4), np.nan, np.float32), r"pressure.*nan.*\(0, 0, 0, 0\)"),
    "planar action": ("actions/action", np.zeros((1, 5), np.float32), r"actions/action.*\(1, 5\).*\(N, 7\)"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILED)
def test_wrong_rows_of_own_fields_are_refused(name, dataset):
    path, rows, facts = SPOILED[name]
    group, _, leaf = path.rpartition("/")
    clock = {} if group == "actions" else {"t_ns": np.array([1])}
    with begin(dataset, own_episode(0)) as writer:
        with pytest.raises(FieldError, match=facts):
            writer.append(group, **clock, **{leaf: rows})
        assert writer._behind.stored == {}
        writer.discard()


def test_what_is_declared_must_be_recorded(dataset):
    episode = own_episode(0)
    without = {path: array for path, array in episode.arrays.items() if "tactile" not in path}
    with begin(dataset, episode) as writer:
        append(writer, without)
        with pytest.raises(FieldError, match=r"streams/tactile/pressure.*nothing was appended"):
            writer.seal()
        writer.discard()


WRONG = {
    "parts": (replace(FIELDS[1], parts=FIELDS[1].parts[:1]), r"tcp_velocity.*parts.*\[0, 1\].*3"),
    "bounds": (replace(FIELDS[0], bounds=FIELDS[0].bounds[:3]), "actions/action.*3 bounds.*7"),
    "components": (replace(FIELDS[1], components=("vx",)), "tcp_velocity.*1 components.*3"),
    "standard": (Field(path="streams/wrench/wrench", dtype="float32", shape=("M", 6), unit="lbf"), "wrench.*lbf.*N, N"),
    "place": (Field(path="tactile/pressure", dtype="float32", shape=("T",)), "tactile/pressure.*streams/NAME"),
    "clock": (Field(path="streams/tactile/t_ns", dtype="int64", shape=("T",)), "t_ns.*its clock"),
    "rows": (Field(path="observations/x", dtype="float32", shape=(3,)), "observations/x.*steps"),
    "assumed": (replace(TACTILE, assumed=("colour",)), "colour.*assumed.*unit, axes"),
    "type": (replace(TACTILE, dtype="object"), "object"),
}


@pytest.mark.parametrize("name", WRONG)
def test_declarations_that_contradict_themselves_are_one_line(name):
    field, facts = WRONG[name]
    with pytest.raises(FieldError, match=facts) as caught:
        Declarations([field])
    assert "\n" not in str(caught.value)


def test_two_kinds_of_one_field_are_no_dataset(dataset, tmp_path):
    """The writer, validate, merge and whoever reads them together say the field and the difference."""
    episode = own_episode(0)
    write_episode(episode, dataset.episode_path(0))
    other = own_episode(1)
    metric = OWN.with_own([replace(TACTILE, unit="Pa")])
    with pytest.raises(DatasetError, match=r"declaration/streams/tactile/pressure.*'Pa'.*'kPa'"):
        begin(dataset, other, fields=metric.own)
    write_episode(replace(other, declarations=metric), dataset.episode_path(1))
    found = [one for findings in check_dataset(dataset) for one in findings if one.severity == "error"]
    assert any("streams/tactile/pressure" in str(one) for one in found)
    with pytest.raises(SvflError, match="streams/tactile/pressure"):
        merge([dataset], tmp_path / "merged")
    with pytest.raises(SvflError, match="streams/tactile/pressure"):
        compute_statistics(dataset, [0, 1])


def test_another_action_than_the_standard_one_is_another_kind_of_dataset(dataset):
    write_episode(own_episode(0), dataset.episode_path(0))
    fields = [one for one in FIELDS if one.path != "actions/action"]
    with pytest.raises(DatasetError, match="declaration/actions/action"):
        begin(dataset, own_episode(1), fields=fields)


def test_two_arms_are_two_actions_and_two_wrenches_keep_their_tares(tmp_path):
    arms = [pose_action(0.02, 0.1, path=f"actions/{side}") for side in ("left", "right")]
    declared = Declarations([*arms, *wrench_stream("left", axes="base"), *wrench_stream("right", axes="base")])
    t_ns, rng = np.arange(4) * 50_000_000, np.random.default_rng(0)
    arrays: dict[str, np.ndarray] = {"observations/t_ns": t_ns}
    for side in ("left", "right"):
        arrays |= {
            f"actions/{side}": rng.uniform(-0.01, 0.01, (3, 7)).astype(np.float32),
            f"streams/{side}/t_ns": t_ns, f"streams/{side}/wrench": rng.normal(0, 1, (4, 6)).astype(np.float32),
            f"streams/{side}/tare": rng.normal(0, 1, 6),
        }  # fmt: skip
        arrays[f"actions/{side}"][:, 6] = 1
    episode = replace(own_episode(0), arrays=arrays, declarations=declared)
    write_episode(episode, tmp_path / "e.hdf5")
    read = read_episode(tmp_path / "e.hdf5")
    assert len(read) == 3
    assert read.declarations.at("streams/left/wrench").parts == read.declarations.at("streams/wrench/wrench").parts
    assert_prefix(read.arrays, arrays)


def test_merged_and_packed_datasets_keep_declarations(tmp_path):
    one, other = own_dataset(tmp_path / "a", 2), own_dataset(tmp_path / "b", 2)
    for index in other.indices:
        episode = replace(own_episode(index + 5), meta=replace(own_episode(index + 5).meta, index=index))
        write_episode(episode, other.episode_path(index))
    merge([one, other], tmp_path / "c")
    merged = Dataset.open(tmp_path / "c")
    assert len(merged) == 4
    assert all(merged.episode(index).declarations == OWN for index in merged.indices)


@pytest.mark.parametrize("rate", [0, -5, "fast", None, True, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused_at_once(dataset, rate):
    """Not left out in silence: later on nobody would compare with it."""
    with pytest.raises(UsageError, match=r"rates_hz\['streams/wrench'\] is .*above 0"):
        EpisodeWriter(dataset, own_episode(0).meta, {}, FIELDS, rates_hz={"streams/wrench": rate})


def recorded(dataset, task="wiping", fields=(), index=NEXT):
    meta = replace(own_episode(0).meta, task=task, index=index, config={})
    with EpisodeWriter(dataset, meta, {}, fields) as writer:
        writer.append("observations", t_ns=np.array([0, 50_000_000]))
        writer.append("actions", action=np.zeros((1, 7), np.float32))
        return writer.seal()


def test_a_dataset_of_several_tasks_holds_each_of_them(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "kitchen", "pouring+wiping", 0, {})
    for task in ("wiping", "pouring", "wiping"):
        recorded(dataset, task, FIELDS[:1])
    assert [dataset.episode(index).meta.task for index in dataset.indices] == ["wiping", "pouring", "wiping"]
    with pytest.raises(DatasetError, match=r"not 'baking'; a dataset of both is created .* 'pouring\+wiping\+baking'"):
        recorded(dataset, "baking", FIELDS[:1])


def test_two_declarations_differ_by_what_differs(dataset):
    """And not by two pages of JSON."""
    recorded(dataset, fields=[pose_action(0.02, 0.1)])
    with pytest.raises(DatasetError, match=r"actions/action is bounds \[\[-0.02, 0.02\], .* but bounds \[") as found:
        recorded(dataset, fields=[pose_action(0.02, 0.2)])
    assert "components" not in str(found.value)


def test_notes_last_as_long_as_any_stream(dataset):
    """Annotations and declared gaps need no wrench: a stream of one's own may go on after the last observation."""
    words = Field(path="streams/slow/level", dtype="float32", shape=("T",))
    with EpisodeWriter(dataset, replace(own_episode(0).meta, index=NEXT), {}, [FIELDS[0], words]) as writer:
        writer.append("observations", t_ns=np.array([0, 50_000_000]))
        writer.append("actions", action=np.zeros((1, 7), np.float32))
        writer.append("streams/slow", t_ns=np.array([0, 200_000_000, 400_000_000]), level=np.zeros(3, np.float32))
        writer.gap("streams/slow", 200_000_000, None, "unplugged")
        writer.seal(success=False)
    relabel(dataset, 0, with_annotation("slip", 0.3, 0.4))
    with pytest.raises(UsageError, match=r"end <= 0.4 s"):
        relabel(dataset, 0, with_annotation("slip", 0.3, 0.41))
    gap, slip = dataset.read(0).meta.annotations
    assert (gap["name"], gap["end_ns"]) == ("gap", 400_000_000)
    assert (slip["name"], slip["end_ns"]) == ("slip", 400_000_000)
