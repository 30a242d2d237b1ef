"""Recording piece by piece gives what writing at once gives, or is refused before a byte is stored."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, FormatError, UsageError
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.episode import Episode
from svfl_data.schema.fields import FIELDS
from svfl_data.storage.store import episode_bytes, read_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.recording import append_all, constants_of, groups_of, start

RATES = {"streams/wrench": 500, "cameras/front": 20}


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "recorded", "centering", 0, {})


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(
    steps=st.integers(0, 60),
    size=st.integers(1, 12),
    pieces=st.integers(1, 12),
    seed=st.integers(0, 2**32 - 1),
    text=st.text(alphabet=st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=9),
    without=st.sets(st.sampled_from(["joints", "object", "depth"])),
)
def test_recorded_in_pieces_equals_written_at_once_to_the_byte(
    tmp_path_factory, steps, size, pieces, seed, text, without
):
    rng = np.random.default_rng(seed)
    dataset = Dataset.create_or_resume(tmp_path_factory.mktemp("w") / "d", "centering", 0, {})
    arrays = {
        path: array for path, array in episode_arrays(rng, steps, size).items() if not without & set(path.split("/"))
    }
    arrays |= {f"extra/{n}": rng.random((rows, 5)) for n, rows in (("tactile/left", steps), ("empty/none", 0))}
    meta = replace(make_episode().meta, config={"note": text}, annotations=[{"name": text, "start_ns": 0, "end_ns": 1}])
    with EpisodeWriter(dataset, replace(meta, index=NEXT), constants_of(arrays)) as writer:
        append_all(writer, arrays, pieces, rng)
        path = writer.seal()
    assert path.read_bytes() == episode_bytes(Episode(meta, arrays))
    assert list((dataset.path / ".inflight").iterdir()) == []


def test_streams_longer_than_a_block_are_the_same_bytes(dataset):
    """Blocks, chunks and journal records end at different rows; an hour of force is 1.8 million of them."""
    arrays = episode_arrays(np.random.default_rng(0), steps=3, size=40)
    rows = 130_001
    arrays["streams/wrench/t_ns"] = np.arange(rows) * 2_000_000
    arrays["streams/wrench/wrench"] = np.random.default_rng(0).normal(size=(rows, 6)).astype(np.float32)
    arrays["extra/pressure/map"] = np.random.default_rng(0).random((700, 40, 60))
    with start(dataset) as writer:
        append_all(writer, arrays, pieces=7)
        path = writer.seal()
    assert path.read_bytes() == episode_bytes(Episode(make_episode().meta, arrays))


def test_labels_success_and_annotations_may_come_at_the_end(dataset):
    episode = make_episode()
    late = {path: array for path, array in episode.arrays.items() if path.startswith("labels/")}
    early = {path: array for path, array in constants_of(episode.arrays).items() if path not in late}
    contact = {"name": "contact", "start_ns": 5, "end_ns": 9}
    with EpisodeWriter(dataset, replace(episode.meta, success=False), early, rates_hz=RATES) as writer:
        append_all(writer, episode.arrays)
        path = writer.seal(success=True, annotations=[contact], constants=late)
    read = read_episode(path)
    assert (read.meta.success, read.meta.annotations) == (True, [contact])
    assert read.meta.config["rates_hz"] == RATES
    np.testing.assert_array_equal(read.label_offset, episode.label_offset)


def test_configuration_and_a_later_tare_may_come_at_the_end(dataset):
    episode, later = make_episode(), np.arange(6.0)
    assert not np.array_equal(episode.tare, later)
    with start(dataset, rates_hz=RATES) as writer:
        append_all(writer, episode.arrays)
        beats = np.arange(len(episode))
        path = writer.seal(
            config={"ended": "stopped"}, constants={"streams/wrench/tare": later, "extra/beat_ns": beats}
        )
    read = read_episode(path)
    assert read.meta.config == episode.meta.config | {"rates_hz": RATES, "ended": "stopped"}
    np.testing.assert_array_equal(read.tare, later)
    np.testing.assert_array_equal(read["extra/beat_ns"], beats)


def recorded(dataset, seed: int, **words) -> None:
    with start(dataset) as writer:
        append_all(writer, make_episode(seed).arrays)
        writer.seal(**words)


def test_an_episode_that_is_recorded_again_takes_the_place_of_the_first(dataset):
    for seed in (0, 1):
        recorded(dataset, seed)
    recorded(dataset, 2, replaces=0)
    assert dataset.indices == [0, 1]
    assert dataset.read(0).meta.index == 0
    for index, seed in ((0, 2), (1, 1)):
        np.testing.assert_array_equal(dataset.read(index).wrench, make_episode(seed).wrench)
    assert list((dataset.path / ".inflight").iterdir()) == []
    recorded(dataset, 3)
    assert dataset.indices == [0, 1, 2]


def test_what_dies_before_it_takes_the_place_leaves_both(dataset, monkeypatch):
    def dies(*_, **__):
        raise RuntimeError

    recorded(dataset, 0)
    with monkeypatch.context() as patch:
        patch.setattr("svfl_data.recording.writer.publish", dies)
        with pytest.raises(RuntimeError):
            recorded(dataset, 1, replaces=0)
    np.testing.assert_array_equal(dataset.read(0).wrench, make_episode(0).wrench)
    repair_dataset(dataset.path)
    assert dataset.indices == [0, 1]
    np.testing.assert_array_equal(dataset.read(1).wrench, make_episode(1).wrench)


def test_what_was_appended_may_be_reused_by_the_caller(dataset):
    episode = make_episode()
    buffer = {path: array.copy() for path, array in episode.arrays.items()}
    with start(dataset) as writer:
        append_all(writer, buffer)
        for array in buffer.values():
            array[...] = 0
        path = writer.seal()
    np.testing.assert_array_equal(read_episode(path).wrench, episode.wrench)


def test_several_threads_may_append(dataset):
    episode = make_episode(steps=40)
    with start(dataset, episode, flush_s=0.0) as writer:

        def feed(group, columns):
            for row in range(len(next(iter(columns.values())))):
                writer.append(group, **{name: array[row : row + 1] for name, array in columns.items()})

        threads = [threading.Thread(target=feed, args=item) for item in groups_of(episode.arrays).items()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        path = writer.seal()
    assert path.read_bytes() == episode_bytes(episode)


def wrench(rows=2, **changes):
    columns = {"t_ns": np.arange(rows), "wrench": np.zeros((rows, 6), np.float32)} | changes
    return "streams/wrench", {name: array for name, array in columns.items() if array is not None}


def camera(rows=2, **changes):
    columns = {
        "t_ns": np.arange(rows),
        "color": np.zeros((rows, 16, 16, 3), np.uint8),
        "depth": np.zeros((rows, 16, 16), np.uint16),
    } | changes
    return "cameras/front", {name: array for name, array in columns.items() if array is not None}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (wrench(wrench=np.full((2, 6), np.nan, np.float32)), r"streams/wrench/wrench.*nan.*\(0, 0\)"),
        (wrench(wrench=np.zeros((2, 6))), "streams/wrench/wrench.*float64.*float32"),
        (wrench(wrench=np.zeros((2, 5), np.float32)), r"streams/wrench/wrench.*\(2, 5\).*\(M, 6\)"),
        (wrench(wrench=np.zeros((3, 6), np.float32)), "streams/wrench/wrench.*M = 3.*streams/wrench/t_ns.*M = 2"),
        (wrench(t_ns=None), "streams/wrench/t_ns.*missing"),
        (wrench(tare=np.zeros(6)), "streams/wrench/tare.*constant"),
        (wrench(temperature=np.zeros(2)), "streams/wrench/temperature.*not declared.*observations/t_ns"),
        (camera(color=np.zeros((2, 17, 16, 3), np.uint8)), "cameras/front/depth.*H = 16.*cameras/front/color.*H = 17"),
        (("cameras/wrist", camera()[1]), "cameras/wrist/depth_scale.*missing"),
        (("streams/joints", {"position": np.zeros((1, 9), np.float32)}), "streams/joints/t_ns.*missing"),
        (("extra/own", {"a": np.zeros(2), "b": np.zeros(3)}), r"extra/own/b.*\(3,\).*\b2 rows.*extra/own/a"),
        (("extra/../own", {"a": np.zeros(2)}), r"extra/\.\./own/a.*name"),
        (("extra//own", {"a": np.zeros(2)}), "extra//own/a.*name"),
        (("extra/own", {"\x1b[2J": np.zeros(2)}), r"extra/own/\\x1b\[2J.*name"),
        (("extra/own", {"a": np.array(["text"])}), "extra/own/a.*<U4.*numbers"),
        (("nowhere", {"a": np.zeros(2)}), "nowhere/a.*not declared.*observations/t_ns"),
        (("actions", {}), "actions.*no rows"),
    ],
)
def test_wrong_rows_are_refused_and_none_is_stored(dataset, wrong, message):
    group, columns = wrong
    episode = make_episode()
    with start(dataset) as writer:
        with pytest.raises(FieldError, match=message):
            writer.append(group, **columns)
        writer.flush()
        assert writer._behind.stored == {}
        append_all(writer, episode.arrays)
        sealed = read_episode(writer.seal(despite_faults=True))
    assert sealed.arrays.keys() == episode.arrays.keys()
    for path, array in episode.arrays.items():
        np.testing.assert_array_equal(sealed.arrays[path], array)


@pytest.mark.parametrize(
    ("then", "message"),
    [
        (camera(color=np.zeros((2, 16, 20, 3), np.uint8), depth=np.zeros((2, 16, 20), np.uint16)), "W = 20.*W = 16"),
        (camera(depth=None), "cameras/front.*cameras/front/depth uint16"),
    ],
)
def test_a_camera_that_changes_within_an_episode_is_refused(dataset, then, message):
    with start(dataset) as writer:
        writer.append(camera()[0], **camera()[1])
        with pytest.raises(FieldError, match=message):
            writer.append(then[0], **then[1])
        writer.discard()


def record_one(dataset, arrays, **kwargs):
    with EpisodeWriter(dataset, replace(make_episode().meta, index=NEXT), constants_of(arrays), **kwargs) as writer:
        append_all(writer, arrays)
        return writer.seal()


def changed_pose(arrays):
    arrays["cameras/front/T_base_camera"][0, 3] += 0.01
    return arrays


@pytest.mark.parametrize(
    ("change", "rates", "message"),
    [
        (changed_pose, RATES, r"cameras/front/T_base_camera.*\b1\.01\b.*\b1\.0\b.*episode 0\b"),
        (lambda arrays: arrays, RATES | {"streams/wrench": 1000}, r"rates_hz/streams/wrench.*\b1000\b.*\b500\b"),
        (
            lambda _: episode_arrays(np.random.default_rng(0), size=20),
            RATES,
            "cameras/front/color.*20, 20, 3.*16, 16, 3",
        ),
    ],
)
def test_a_changed_camera_or_rate_is_refused_on_resume(dataset, change, rates, message):
    record_one(dataset, episode_arrays(np.random.default_rng(0)), rates_hz=RATES)
    before = sorted(file.name for file in dataset.path.iterdir())
    with pytest.raises(DatasetError, match=message):
        record_one(dataset, change(episode_arrays(np.random.default_rng(0))), rates_hz=rates)
    assert sorted(file.name for file in dataset.path.iterdir()) == before


def test_what_is_said_to_vary_may_change(dataset):
    record_one(dataset, episode_arrays(np.random.default_rng(0)), rates_hz=RATES)
    moved = changed_pose(episode_arrays(np.random.default_rng(0)))
    record_one(dataset, moved, rates_hz=RATES, varies=["cameras/front/T_base_camera"])
    smaller = episode_arrays(np.random.default_rng(0), size=8)
    record_one(dataset, smaller, rates_hz=RATES, varies=["cameras/front"])
    assert dataset.indices == [0, 1, 2]


def test_a_recording_that_cannot_be_right_never_starts(dataset, tmp_path):
    episode = make_episode()
    constants = constants_of(episode.arrays)
    with pytest.raises(FormatError, match="/absent: "):
        EpisodeWriter(tmp_path / "absent", episode.meta, constants)
    with pytest.raises(DatasetError, match=r"'centering'.*'pushing'"):
        EpisodeWriter(dataset, replace(episode.meta, task="pushing"), constants)
    with pytest.raises(FieldError, match=r"episode 0\b.*config\.gain.*nan"):
        EpisodeWriter(dataset, replace(episode.meta, config={"gain": float("nan")}), constants)
    with pytest.raises(FieldError, match=rf"episode 0\b.*\b\d{{7}} bytes.*\b{2**21}\b"):
        EpisodeWriter(dataset, replace(episode.meta, config={"note": "x" * 2**22}), constants)
    with pytest.raises(FieldError, match=r"streams/temperature/celsius.*not declared"):
        EpisodeWriter(dataset, episode.meta, constants | {"streams/temperature/celsius": np.zeros(1)})
    with pytest.raises(FieldError, match=r"actions/action.*append"):
        EpisodeWriter(dataset, episode.meta, constants | {"actions/action": episode.action})
    assert [file.name for file in dataset.path.iterdir()] == ["dataset.json"]


def test_an_unwhole_episode_is_not_sealed_but_can_be_completed(dataset):
    episode = make_episode()
    begun = {f"actions/{name}": episode.arrays[f"actions/{name}"][:-1] for name in ("action", "expert_action")}
    last = {name: episode.arrays[f"actions/{name}"][-1:] for name in ("action", "expert_action")}
    with start(dataset) as writer:
        append_all(writer, episode.arrays | begun)
        with pytest.raises(FieldError, match=r"episode 0\b.*\b5 observations.*\b4 actions.*\b3\b"):
            writer.seal()
        writer.append("actions", **last)
        assert writer.seal().read_bytes() == episode_bytes(episode)
        with pytest.raises(UsageError, match=r"episode 0\b.*\bended\b"):
            writer.append("actions", **last)


def test_indices_are_taken_in_turn_and_never_twice(dataset):
    first, second = start(dataset), start(dataset)
    assert (first.meta.index, second.meta.index) == (0, 1)
    with pytest.raises(DatasetError, match=r"episode 1.*svfl-data repair"):
        EpisodeWriter(dataset, replace(make_episode().meta, index=1), constants_of(make_episode().arrays))
    second.discard()
    append_all(first, make_episode().arrays)
    first.seal()
    with pytest.raises(DatasetError, match=r"episode 0.*exists"):
        EpisodeWriter(dataset, make_episode().meta, constants_of(make_episode().arrays))
    third = start(dataset)
    assert third.meta.index == 1
    third.discard()
    assert dataset.indices == [0]


def test_a_discarded_episode_leaves_nothing(dataset):
    with start(dataset) as writer:
        append_all(writer, make_episode().arrays)
        writer.discard()
    assert list((dataset.path / ".inflight").iterdir()) == []
    assert dataset.indices == []


def test_an_exception_keeps_every_reading_for_repair(dataset):
    episode = make_episode()

    def record_until_the_arm_stops():
        with start(dataset) as writer:
            append_all(writer, episode.arrays)
            raise RuntimeError("arm stopped")

    with pytest.raises(RuntimeError, match="arm stopped"):
        record_until_the_arm_stops()
    (action,) = repair_dataset(dataset.path)
    assert (action.done, action.path.name) == ("salvaged", "episode_000000.hdf5")
    saved = read_episode(action.path)
    assert not saved.meta.success
    for path, array in episode.arrays.items():
        np.testing.assert_array_equal(saved.arrays[path], array)


def rows_of(field):
    """Two rows of a field that any field may have."""
    row = [size if isinstance(size, int) else 3 for size in field.shape[1:]]
    if field.path.endswith("/t_ns"):
        return np.array([1, 2])
    if row[-1:] == [7] and field.path.endswith("/pose"):
        return np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1))
    if row == [4, 4]:
        return np.tile(np.eye(4), (2, 1, 1))
    return np.zeros((2, *row), field.dtype)


@pytest.mark.parametrize("group", sorted({field.group for field in FIELDS if field.grows}))
def test_every_growing_field_can_be_appended(group, dataset):
    """The writer knows no field by name: what is declared can be recorded."""
    columns = {
        field.path.rpartition("/")[2]: rows_of(field) for field in FIELDS if field.group == group and field.grows
    }
    group = group.replace("{camera}", "front")
    with start(dataset) as writer:
        writer.append(group, **columns)
        writer.flush()
        assert writer._behind.stored == {f"{group}/{name}": 2 for name in columns}
        writer.discard()
