"""What goes wrong while an episode is recorded is known when it is sealed, and stays with it."""

import re
import threading
from dataclasses import replace

import numpy as np
import pytest

from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError, StorageError, UsageError
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.storage.store import episode_bytes, read_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.recording import append_all, constants_of, groups_of, start

MS = 1_000_000


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "recorded", "centering", 0, {})


def episode_of(seconds: float = 3.0):
    """An episode at 20 Hz, wrench at 500 Hz."""
    return make_episode(steps=round(20 * seconds), size=4)


def without_wrench(arrays):
    return {path: array for path, array in arrays.items() if not path.startswith("streams/wrench/")} | {
        path: array for path, array in arrays.items() if path == "streams/wrench/tare"
    }


def open_writer(dataset, episode, **kwargs) -> EpisodeWriter:
    return EpisodeWriter(
        dataset, replace(episode.meta, index=NEXT, success=False), constants_of(episode.arrays), **kwargs
    )


def wrench_of(episode, keep) -> dict[str, np.ndarray]:
    rows = keep(episode.wrench_t_ns)
    return {"t_ns": episode.wrench_t_ns[rows], "wrench": episode.wrench[rows]}


def begun(work) -> tuple[threading.Thread, list[Exception]]:
    """A thread, and what it will have raised."""
    errors: list[Exception] = []

    def run() -> None:
        try:
            work()
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, errors


def in_thread(work) -> list[Exception]:
    thread, errors = begun(work)
    thread.join()
    return errors


# Refused readings


def test_a_refused_reading_in_a_sensors_thread_keeps_the_episode_from_being_a_success(dataset):
    episode = episode_of()

    def feel(writer):
        for row, t_ns in enumerate(episode.wrench_t_ns):
            reading = episode.wrench[row : row + 1] * (np.nan if row == 200 else 1)
            writer.append("streams/wrench", t_ns=t_ns[None], wrench=reading)

    with open_writer(dataset, episode) as writer:
        append_all(writer, without_wrench(episode.arrays))
        errors = in_thread(lambda: feel(writer))
        facts = r"streams/wrench at 0\.402 s .*\bnan\b.*streams/wrench .*\b2\.80 s "
        with pytest.raises(FieldError, match=facts) as refusal:
            writer.seal(success=True)
        assert "\n" not in str(refusal.value)
        path = writer.seal(success=False)
    assert [type(error) for error in errors] == [FieldError]
    (entry,) = read_episode(path).meta.history
    assert entry["tool"] == "EpisodeWriter"
    assert re.search(r"streams/wrench/wrench.*\bnan\b", entry["faults"][0])


def test_a_success_with_a_fault_is_one_when_told_and_the_fault_stays(dataset):
    episode = make_episode()
    with open_writer(dataset, episode) as writer:
        append_all(writer, episode.arrays)
        with pytest.raises(FieldError):
            writer.append("actions", action=np.zeros((1, 4), np.float32))
        saved = read_episode(writer.seal(success=True, despite_faults=True))
    assert saved.meta.success
    assert "shape (1, 4)" in saved.meta.history[0]["faults"][0]


def test_many_faults_are_counted(dataset):
    episode = make_episode()
    with open_writer(dataset, episode) as writer:
        append_all(writer, episode.arrays)
        for _ in range(130):
            with pytest.raises(FieldError):
                writer.append("actions", action=np.zeros((1, 4), np.float32))
        assert len(writer.faults) == 101
        assert writer.faults[-1] == "and 30 more"
        writer.discard()


def test_a_fault_survives_the_recorder(dataset):
    episode = make_episode()
    with open_writer(dataset, episode) as writer:
        append_all(writer, episode.arrays)
        with pytest.raises(FieldError):
            writer.append("actions", action=np.zeros((1, 4), np.float32))
    (action,) = repair_dataset(dataset.path)
    assert "shape (1, 4)" in read_episode(action.path).meta.history[0]["faults"][0]


# Gaps


@pytest.mark.parametrize("known_end", [True, False])
def test_a_declared_gap_is_no_fault_and_is_marked(dataset, known_end):
    episode = episode_of()
    with open_writer(dataset, episode, rates_hz={"streams/wrench": 500}) as writer:
        append_all(writer, without_wrench(episode.arrays))
        writer.append("streams/wrench", **wrench_of(episode, lambda t: t <= 1000 * MS))
        writer.gap("streams/wrench", 1000 * MS, 2000 * MS if known_end else None, "cable")
        writer.gap("streams/wrench", 1000 * MS, None, "cable") if not known_end else None
        writer.append("streams/wrench", **wrench_of(episode, lambda t: t >= 2000 * MS))
        saved = read_episode(writer.seal(success=True))
    assert saved.meta.annotations == [
        {"name": "gap", "stream": "streams/wrench", "start_ns": 1000 * MS, "end_ns": 2000 * MS, "reason": "cable",
         "by": {"tool": "EpisodeWriter"}}
    ]  # fmt: skip
    assert len(saved.wrench) == np.count_nonzero((saved.wrench_t_ns <= 1000 * MS) | (saved.wrench_t_ns >= 2000 * MS))
    assert not [one for one in check_episode(saved) if one.severity == "error"]


def test_a_gap_that_never_ends_lasts_until_the_end_of_the_episode(dataset):
    episode = episode_of()
    with open_writer(dataset, episode) as writer:
        append_all(writer, without_wrench(episode.arrays))
        writer.append("streams/wrench", **wrench_of(episode, lambda t: t <= 1000 * MS))
        writer.gap("streams/wrench", 1000 * MS, None, "unplugged")
        saved = read_episode(writer.seal(success=True))
    assert saved.meta.annotations[0]["end_ns"] == saved.t_ns[-1]


def test_a_gap_survives_the_recorder(dataset):
    episode = episode_of()
    with open_writer(dataset, episode) as writer:
        append_all(writer, without_wrench(episode.arrays))
        writer.append("streams/wrench", **wrench_of(episode, lambda t: t <= 1000 * MS))
        writer.gap("streams/wrench", 1000 * MS, None, "unplugged")
        writer.append("streams/wrench", **wrench_of(episode, lambda t: t >= 2000 * MS))
    (action,) = repair_dataset(dataset.path)
    (gap,) = read_episode(action.path).meta.annotations
    assert (gap["start_ns"], gap["end_ns"], gap["reason"]) == (1000 * MS, 2000 * MS, "unplugged")


@pytest.mark.parametrize(
    ("gap", "error"),
    [(("wrench", 0, 5, "x"), FieldError), (("streams/wrench", 5, 0, "x"), UsageError),
     (("streams/wrench", 0, 5, ""), UsageError)],
)  # fmt: skip
def test_a_gap_that_means_nothing_is_refused(dataset, gap, error):
    with start(dataset) as writer:
        with pytest.raises(error):
            writer.gap(*gap)
        writer.discard()


# Silence


@pytest.mark.parametrize(
    ("keep", "facts"),
    [
        (lambda t: t < 400 * MS, r"streams/wrench .*\b2\.80 s "),
        (lambda t: (t <= 1000 * MS) | (t >= 1600 * MS), r"streams/wrench .*\b80% .*\b3\.00 s\b"),
        (lambda t: t > 1500 * MS, r"streams/wrench .*\b57% .*\b3\.00 s\b"),
    ],
)
@pytest.mark.parametrize("rates", [None, {"streams/wrench": 500}])
def test_a_stream_that_falls_silent_keeps_the_episode_from_being_a_success(dataset, keep, facts, rates):
    episode = episode_of()
    with open_writer(dataset, episode, rates_hz=rates) as writer:
        append_all(writer, without_wrench(episode.arrays))
        writer.append("streams/wrench", **wrench_of(episode, keep))
        with pytest.raises(FieldError, match=facts):
            writer.seal(success=True)
        assert read_episode(writer.seal(success=False)).meta.history[0]["faults"]


def test_a_declared_stream_that_never_came_is_named(dataset):
    episode = make_episode()
    with open_writer(dataset, episode, rates_hz={"streams/gripper": 100}) as writer:
        append_all(writer, episode.arrays)
        with pytest.raises(FieldError, match=r"streams/gripper.*100 Hz.*nothing"):
            writer.seal(success=True)
        writer.discard()


@pytest.mark.parametrize("group", ["streams/tags", "extra/buttons"])
def test_what_an_episode_need_not_have_may_begin_late_and_events_may_be_rare(dataset, group):
    episode = episode_of()
    arrays = {path: array for path, array in episode.arrays.items() if not path.startswith("streams/tags/")}
    columns = {"t_ns": episode.t_ns[40:]}
    if group == "streams/tags":
        columns = {name: array[40:] for name, array in groups_of(episode.arrays)[group].items()}
    with open_writer(dataset, episode) as writer:
        append_all(writer, arrays)
        writer.append(group, **columns)
        assert read_episode(writer.seal(success=True)).meta.history == []


# Units and rates


@pytest.mark.parametrize(("divide", "unit"), [(1_000, "microseconds"), (1_000_000, "milliseconds")])
def test_time_stamps_in_another_unit_are_named(dataset, divide, unit):
    episode = episode_of()
    arrays = {path: array // divide if path.endswith("/t_ns") else array for path, array in episode.arrays.items()}
    with open_writer(dataset, episode, rates_hz={"streams/wrench": 500}) as writer:
        append_all(writer, arrays)
        with pytest.raises(FieldError, match=rf"streams/wrench [^;]*500 Hz[^;]*;[^;]*{unit}[^;]*nanoseconds"):
            writer.seal(success=True)
        writer.discard()
    with open_writer(dataset, episode, varies=["streams/wrench"]) as writer:
        append_all(writer, arrays)
        with pytest.raises(FieldError, match=r"streams/wrench [^;,]*\de\+\d\d Hz[^;,]*;[^;]*nanoseconds"):
            writer.seal(success=True)
        writer.discard()


def test_a_driver_that_fell_back_to_a_tenth_is_named(dataset):
    episode = episode_of()
    with open_writer(dataset, episode, rates_hz={"streams/wrench": 500}) as writer:
        append_all(writer, without_wrench(episode.arrays))
        writer.append("streams/wrench", t_ns=episode.wrench_t_ns[::10], wrench=episode.wrench[::10])
        with pytest.raises(FieldError, match=r"streams/wrench .*\b50 Hz.*\b500 Hz"):
            writer.seal(success=True)
        assert read_episode(writer.seal(success=True, despite_faults=True)).meta.success


# Clocks ascend


@pytest.mark.parametrize("t_ns", [[20, 10], [20, 20], [10], [5], [11, 12, 12]])
@pytest.mark.parametrize("group", ["streams/wrench", "extra/own"])
def test_a_reading_that_is_not_newer_is_refused_and_named(dataset, t_ns, group):
    def rows(count):
        return {"wrench": np.zeros((count, 6), np.float32)} if group == "streams/wrench" else {}

    with start(dataset) as writer:
        writer.append(group, t_ns=np.array([1, 10]), **rows(2))
        before, late = [10, *t_ns][-2:]
        with pytest.raises(FieldError, match=rf"{group}.*row {len(t_ns) + 1}\b.*\b{late}\b.*\b{before}\b"):
            writer.append(group, t_ns=np.array(t_ns), **rows(len(t_ns)))
        writer.append(group, t_ns=np.array([11]), **rows(1))
        writer.flush()
        assert writer._behind.stored[f"{group}/t_ns"] == 3
        writer.discard()


def test_late_readings_may_be_dropped_and_are_counted(dataset):
    episode = make_episode()
    t_ns = episode.wrench_t_ns
    with open_writer(dataset, episode) as writer:
        append_all(writer, without_wrench(episode.arrays))
        writer.append("streams/wrench", late="drop", t_ns=t_ns[:50], wrench=episode.wrench[:50])
        mixed = np.concatenate([t_ns[40:60], t_ns[30:35]])
        writer.append("streams/wrench", late="drop", t_ns=mixed, wrench=np.zeros((25, 6), np.float32))
        writer.append("streams/wrench", late="drop", t_ns=t_ns[60:], wrench=episode.wrench[60:])
        saved = read_episode(writer.seal(success=True))
    np.testing.assert_array_equal(saved.wrench_t_ns, t_ns)
    assert saved.meta.history == [{"tool": "EpisodeWriter", "late": {"streams/wrench": 15}}]


def test_observations_are_never_dropped(dataset):
    with start(dataset) as writer:
        with pytest.raises(UsageError, match=r"observations.*action"):
            writer.append("observations", late="drop", t_ns=np.array([1]), proprio=np.zeros((1, 5), np.float32))
        writer.discard()


# Waiting for nothing


@pytest.fixture
def held_disk(monkeypatch):
    """A disk that takes nothing until told: (it was asked, let it go)."""
    import svfl_data.recording.journal_writer as journal

    asked, go = threading.Event(), threading.Event()
    write_all = journal.write_all

    def held(*arguments):
        if threading.current_thread().name == "write behind":
            asked.set()
            go.wait()
        write_all(*arguments)

    monkeypatch.setattr(journal, "write_all", held)
    yield asked, go
    go.set()


def test_append_returns_while_the_disk_is_busy(dataset, held_disk):
    asked, go = held_disk
    episode = make_episode()
    with start(dataset, episode, flush_s=0.001) as writer:
        arrays = dict(episode.arrays)
        writer.append("streams/wrench", t_ns=arrays["streams/wrench/t_ns"], wrench=arrays["streams/wrench/wrench"])
        asked.wait()
        append_all(writer, without_wrench(arrays), rng=NoFlush())
        assert writer._behind.stored == {}  # all of it was taken while the first write is held
        go.set()
        assert writer.seal().read_bytes() == episode_bytes(episode)


class NoFlush:
    """Stands for a generator whose `random` never asks for a flush."""

    def random(self) -> float:
        return 1.0


@pytest.mark.parametrize("when_full", ["wait", "refuse"])
def test_memory_is_bounded_when_the_disk_is_slower_than_the_data(dataset, held_disk, when_full):
    asked, go = held_disk
    episode = make_episode(steps=20)
    columns = groups_of(episode.arrays)["cameras/front"]
    size = sum(array[:1].nbytes for array in columns.values())
    with start(dataset, episode, flush_s=0.001, most_waiting_bytes=5 * size, when_full=when_full) as writer:
        done = []

        def feed():
            for row in range(21):
                writer.append("cameras/front", **{name: array[row : row + 1] for name, array in columns.items()})
                done.append(row)

        camera, errors = begun(feed)
        asked.wait()
        if when_full == "refuse":
            camera.join()
            assert len(done) == 5
            assert "slower than the data" in writer.faults[0]
        assert writer._behind._bytes <= 5 * size
        go.set()
        camera.join()
        assert [type(error) for error in errors] == ([StorageError] if when_full == "refuse" else [])
        writer.flush()
        assert writer._behind.stored["cameras/front/t_ns"] == len(done) == (5 if when_full == "refuse" else 21)
        writer.discard()


def test_what_the_disk_refused_in_the_background_is_said_and_nothing_of_it_is_lost(dataset, monkeypatch):
    import svfl_data.recording.journal_writer as journal

    episode, tried, appended = make_episode(), threading.Event(), threading.Event()
    write_all = journal.write_all

    def full(*arguments):
        tried.set()
        appended.wait()  # or an append of those below would tell it already
        raise OSError(122, "Disk quota exceeded")

    with start(dataset, episode, flush_s=0.001) as writer:
        monkeypatch.setattr(journal, "write_all", full)
        append_all(writer, {path: array for path, array in episode.arrays.items() if "wrench" in path}, rng=NoFlush())
        appended.set()
        tried.wait()
        with pytest.raises(StorageError, match=r"episode_000000\.journal.*Disk quota exceeded"):
            writer.flush()
        with pytest.raises(StorageError, match="Disk quota exceeded"):
            writer.append("actions", action=episode.action, expert_action=episode.arrays["actions/expert_action"])
        monkeypatch.setattr(journal, "write_all", write_all)
        writer.flush()
        append_all(writer, without_wrench(episode.arrays))
        saved = read_episode(writer.seal(despite_faults=True))
    for path, array in episode.arrays.items():
        np.testing.assert_array_equal(saved.arrays[path], array)


def test_rows_of_an_append_that_met_a_full_disk_are_stored_once(dataset, monkeypatch):
    """With `flush_s=0` an append meets the disk itself: what was taken is told at the next one, which takes nothing."""
    import svfl_data.recording.journal_writer as journal

    episode, write_all, left = make_episode(), journal.write_all, [3]

    def full(*arguments):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(28, "No space left on device")
        write_all(*arguments)

    with start(dataset, episode, flush_s=0.0) as writer:
        monkeypatch.setattr(journal, "write_all", full)
        t_ns, wrench = episode.wrench_t_ns, episode.wrench
        writer.append("streams/wrench", t_ns=t_ns[:50], wrench=wrench[:50])
        with pytest.raises(StorageError, match="No space left"):
            writer.append("streams/wrench", t_ns=t_ns[50:], wrench=wrench[50:])
        monkeypatch.setattr(journal, "write_all", write_all)
        writer.append("streams/wrench", t_ns=t_ns[50:], wrench=wrench[50:])
        append_all(writer, without_wrench(episode.arrays))
        saved = read_episode(writer.seal(despite_faults=True))
    for path, array in episode.arrays.items():
        np.testing.assert_array_equal(saved.arrays[path], array)


def test_an_episode_is_sealed_beside_the_next_one(dataset, monkeypatch):
    import svfl_data.recording.writer as module

    began, go, build = threading.Event(), threading.Event(), module.build

    def slow(*arguments):
        began.set()
        go.wait()
        return build(*arguments)

    monkeypatch.setattr(module, "build", slow)
    episode = make_episode()
    with start(dataset, episode) as writer:
        append_all(writer, episode.arrays)
        sealing = writer.seal_beside()
        with pytest.raises(UsageError, match=r"episode 0\b.*\bended\b"):
            writer.append("actions", action=episode.action)
    began.wait()
    with start(dataset, episode) as following:
        append_all(following, episode.arrays)
        assert not sealing.done()
        go.set()
        second = following.seal()
    assert sealing.result().read_bytes() == episode_bytes(episode)
    assert second.read_bytes() == episode_bytes(replace(episode, meta=replace(episode.meta, index=1)))
    assert list((dataset.path / ".inflight").iterdir()) == []


def test_what_cannot_be_sealed_beside_is_refused_at_once_and_can_go_on(dataset):
    episode = make_episode()
    with start(dataset, episode) as writer:
        append_all(writer, without_wrench(episode.arrays))
        with pytest.raises(FieldError, match=r"streams/wrench/t_ns.*missing"):
            writer.seal_beside()
        append_all(writer, {path: array for path, array in episode.arrays.items() if "streams/wrench/" in path})
        assert writer.seal_beside().result().read_bytes() == episode_bytes(episode)


def test_a_disk_that_refuses_beside_leaves_the_journal(dataset, monkeypatch):
    import svfl_data.recording.writer as module

    def full(*_):
        raise StorageError("cannot write: No space left on device")

    episode = make_episode()
    with start(dataset, episode) as writer:
        append_all(writer, episode.arrays)
        with monkeypatch.context() as patched:
            patched.setattr(module, "build", full)
            with pytest.raises(StorageError, match="No space left"):
                writer.seal_beside().result()
    (action,) = repair_dataset(dataset.path)
    assert action.done == "published"
    assert action.path.read_bytes() == episode_bytes(episode)


def test_arrays_of_the_builder_are_what_these_tests_think():
    arrays = episode_arrays(np.random.default_rng(0), steps=60)
    assert arrays["observations/t_ns"][-1] == 3200 * MS
