"""Kills, full disks and damage: what was sealed stays, what was flushed is saved, what is broken is named.

``SVFL_CAMPAIGN=1 pytest tests/svfl_data/recording/test_reliability.py -s`` runs the numbers of `docs/reliability.md`.
"""

import functools
import json
import mmap
import os
import resource
import shutil
import signal
import subprocess
import time
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest

import svfl_data.recording.writer
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError, FormatError, StorageError
from svfl_data.maintenance.repair import repair_dataset, repair_exit_code
from svfl_data.recording import index_locks
from svfl_data.recording.index_locks import INFLIGHT, NEXT
from svfl_data.recording.journal import HEADER
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.seal import SEAL_SIZE, seal
from svfl_data.storage.store import episode_bytes, read_episode, write_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.child import exit_code, fork, in_child
from tests.helpers.patience import PATIENCE
from tests.helpers.recording import append_all, constants_of, start

pytestmark = pytest.mark.slow

CAMPAIGN = bool(os.environ.get("SVFL_CAMPAIGN"))
KILLS = 200 if CAMPAIGN else 10
LIMITS = 50 if CAMPAIGN else 6
SIZES = 200 if CAMPAIGN else 8
MUTATIONS = 1000 if CAMPAIGN else 200
INTERRUPTS = 100 if CAMPAIGN else 6
CUTS = 1000 if CAMPAIGN else 30


def report(title: str, counts: dict) -> None:
    if CAMPAIGN:
        print(f"\n{title}: {', '.join(f'{count} {what}' for what, count in sorted(counts.items()))}")


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "recorded", "centering", 0, {})


def drawn(draw: list[int]) -> dict[str, np.ndarray]:
    """The truth about an episode of the kill test, from the numbers that are stored with it."""
    rng = np.random.default_rng(draw)
    return episode_arrays(rng, steps=int(rng.integers(2, 30)), size=8)


def step_by_step(writer: EpisodeWriter, arrays: dict[str, np.ndarray]):
    """Record an episode as a robot would; yields after each step."""
    wrench = arrays["streams/wrench/wrench"]
    for step in range(len(arrays["observations/t_ns"])):
        new = slice(0, 100) if step == 0 else slice(75 + 25 * step, 100 + 25 * step)
        writer.append("streams/wrench", t_ns=arrays["streams/wrench/t_ns"][new], wrench=wrench[new])
        row = slice(step, step + 1)
        for group, names in (
            ("cameras/front", ["t_ns", "color", "depth"]),
            ("streams/joints", ["t_ns", "position"]),
            ("streams/object", ["t_ns", "pose"]),
            ("streams/tags", ["t_ns", "pose", "age", "error", "margin", "count"]),
            ("observations", ["t_ns", "proprio"]),
        ):
            writer.append(group, **{name: arrays[f"{group}/{name}"][row] for name in names})
        if step < len(arrays["actions/action"]):
            writer.append("actions", **{name: arrays[f"actions/{name}"][row] for name in ("action", "expert_action")})
        yield step


def record_for_ever(dataset: Dataset, attempt: int, number: int, told: np.ndarray) -> int:
    """Record episode after episode, telling how many are sealed and how many steps of the next one are flushed."""
    for count in range(1_000_000):
        draw = [attempt, number, count]
        arrays = drawn(draw)
        meta = Meta("centering", NEXT, 0, "expert", True, config={"draw": draw})
        with EpisodeWriter(dataset, meta, constants_of(arrays), flush_s=0.0) as writer:
            told[number] = count, 0
            for step in step_by_step(writer, arrays):
                told[number] = count, step
            writer.seal()
            told[number] = count + 1, 0
    return 0


def test_two_killed_writers_lose_nothing_that_was_sealed_or_flushed(dataset):
    rng = np.random.default_rng(0)
    seen: dict[int, list[int]] = {}
    counts: Counter[str] = Counter()
    told = np.frombuffer(mmap.mmap(-1, 32), np.int64).reshape(2, 2)
    for attempt in range(KILLS):
        told[...] = 0
        children = []
        for number in range(2):
            children.append(fork(partial(record_for_ever, dataset, attempt, number, told)))
        time.sleep(rng.uniform(0.02, 0.3))
        for child in rng.permutation(children):
            os.kill(child, signal.SIGKILL)
            time.sleep(rng.uniform(0, 0.02))
            os.waitpid(child, 0)

        published = [index for index in dataset.indices if index not in seen]
        for index in published:
            episode = read_episode(dataset.episode_path(index))
            assert episode.meta.success
            assert episode.meta.index == index
            assert_same(episode.arrays, drawn(episode.meta.config["draw"]))
            seen[index] = episode.meta.config["draw"]
        for number in range(2):
            sealed = {tuple(draw) for draw in seen.values() if draw[:2] == [attempt, number]}
            assert {(attempt, number, count) for count in range(told[number, 0])} <= sealed
        counts["published by writers"] += len(published)
        assert len(list((dataset.path / INFLIGHT).glob("*.journal"))) <= 2

        actions = repair_dataset(dataset.path)
        assert [action.done for action in actions].count("quarantined") <= (told[:, 1] == 0).sum()
        for action in actions:
            counts[f"{action.done} by repair"] += 1
            if action.done == "quarantined" or action.done == "cleared":
                continue
            saved = read_episode(action.path)
            draw = saved.meta.config["draw"]
            truth = drawn(draw)
            assert saved.meta.index not in seen
            seen[saved.meta.index] = draw
            if action.done == "published":
                assert_same(saved.arrays, truth)
            else:
                assert not saved.meta.success
                assert_prefix(saved.arrays, truth)
                sealed, steps = told[draw[1]]
                assert draw[2] > sealed or len(saved) >= min(steps, len(truth["actions/action"]))
                counts["steps salvaged"] += len(saved)
        assert list((dataset.path / INFLIGHT).iterdir()) == []
        assert repair_dataset(dataset.path) == []
    draws = [tuple(draw) for draw in seen.values()]
    assert len(set(draws)) == len(draws)
    report(f"{KILLS} kills of two writers", counts)


def assert_same(found, truth):
    assert found.keys() == truth.keys()
    for path, array in truth.items():
        np.testing.assert_array_equal(found[path], array)


def assert_prefix(found, truth):
    assert found.keys() <= truth.keys()
    for path, array in found.items():
        np.testing.assert_array_equal(array, truth[path][: len(array)] if array.ndim else truth[path])


def test_many_writers_at_once_never_meet(dataset):
    def record_some(number):
        for count in range(5):
            arrays = drawn([0, number, count])
            meta = Meta("centering", NEXT, 0, "expert", True, config={"draw": [0, number, count]})
            with EpisodeWriter(dataset, meta, constants_of(arrays)) as writer:
                append_all(writer, arrays)
                writer.seal()
        return 0

    children = [fork(partial(record_some, number)) for number in range(4)]
    assert [exit_code(child) for child in children] == [0, 0, 0, 0]
    assert dataset.indices == list(range(20))
    draws = {tuple(episode.meta.config["draw"]) for episode in dataset}
    assert draws == {(0, number, count) for number in range(4) for count in range(5)}


def fill(dataset: Dataset, arrays: dict[str, np.ndarray]) -> int:
    """Record until the disk refuses; 10 if while appending, 11 if while sealing, 12 if at the start, 0 if never."""
    meta = Meta("centering", 1, 0, "expert", True)
    phase = 12
    try:
        with EpisodeWriter(dataset, meta, constants_of(arrays), flush_s=0.0) as writer:
            phase = 10
            for _ in step_by_step(writer, arrays):
                pass
            phase = 11
            writer.seal()
    except StorageError as error:
        told = "bytes" in str(error) and "intact" in str(error)
        return phase if told or phase == 12 else 98
    return 0


@pytest.mark.parametrize("images", ["noise", "flat"])
@pytest.mark.parametrize("when", ["recording", "sealing"])
def test_a_file_that_may_not_grow_never_ends_the_process(tmp_path, when, images):
    """RLIMIT_FSIZE refuses writes as a full disk does, wherever tests may run."""
    truth = episode_arrays(np.random.default_rng(1), steps=30, size=24)
    if images == "flat":
        truth["cameras/front/color"][...] = 7
        truth["cameras/front/depth"][...] = 9
    ends: Counter[int] = Counter()
    for limit in np.linspace(3_000, 250_000, LIMITS).astype(int):
        dataset = Dataset.create_or_resume(tmp_path / str(limit), "centering", 0, {})
        write_episode(make_episode(0, steps=30, size=24), dataset.episode_path(0))
        end = in_child(functools.partial(fill_limited, dataset, truth, when, int(limit)))
        ends[end] += 1
        assert end in (0, 10, 11, 12)
        check_after_full_disk(dataset, truth, sealed=end == 0)
        shutil.rmtree(dataset.path)
    assert ends[10 if when == "recording" else 11]
    assert ends[0]
    report(f"file size limits, {images} images, {when}", {f"ended {end}": count for end, count in ends.items()})


def fill_limited(dataset, truth, when, limit) -> int:
    def forbid() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    def limited_build(*arguments):
        forbid()
        return index_locks.build(*arguments)

    if when == "recording":
        forbid()
    else:
        svfl_data.recording.writer.build = limited_build  # of this child process only
    return fill(dataset, truth)


def test_a_full_tmpfs_never_ends_the_process(tmp_path):
    """A real full disk of many sizes; needs leave to mount one."""
    truth = episode_arrays(np.random.default_rng(1), steps=30, size=24)
    disk = tmp_path / "disk"
    disk.mkdir()
    ends: Counter[int] = Counter()
    for size in np.linspace(240_000, 560_000, SIZES).astype(int):
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
        if subprocess.run(mount, capture_output=True, check=False).returncode:
            pytest.skip("mounting a tmpfs needs root; the file size limit above stands for it")
        try:
            dataset = Dataset.create_or_resume(disk / "recorded", "centering", 0, {})
            write_episode(make_episode(0, steps=30, size=24), dataset.episode_path(0))
            end = in_child(lambda dataset=dataset: fill(dataset, truth))
            ends[end] += 1
            assert end in (0, 10, 11, 12)
            subprocess.run(["mount", "-o", "remount,size=10M", str(disk)], check=True)
            check_after_full_disk(dataset, truth, sealed=end == 0)
        finally:
            subprocess.run(["umount", str(disk)], check=True)
    assert ends[10]
    assert ends[11]
    report("tmpfs sizes", {f"ended {end}": count for end, count in ends.items()})


def check_after_full_disk(dataset, truth, sealed):
    """The earlier episode is intact, nothing half-written lies about, and with room again the rest is saved."""
    assert dataset.path.joinpath("episode_000000.hdf5").read_bytes() == episode_bytes(
        make_episode(0, steps=30, size=24)
    )
    assert not list(dataset.path.rglob("*.part"))
    assert dataset.indices == ([0, 1] if sealed else [0])
    assert_prefix(read_episode(dataset.episode_path(1)).arrays, truth) if sealed else None
    for action in repair_dataset(dataset.path):
        assert action.done in ("salvaged", "published", "quarantined")
        if action.done == "published":
            assert_same(read_episode(action.path).arrays, truth)
        if action.done == "salvaged":
            assert_prefix(read_episode(action.path).arrays, truth)


def test_sealing_again_after_making_room_is_possible(dataset, monkeypatch):
    episode = make_episode(0, steps=30, size=24)

    def refuse(*_):
        raise OSError(28, "No space left on device")

    with start(dataset, episode) as writer:
        append_all(writer, episode.arrays)
        with monkeypatch.context() as full:
            full.setattr("svfl_data.storage.sink.write_all", refuse)
            with pytest.raises(StorageError, match=r"episode 0\b.*No space left on device.*\b\d+ bytes.*\b\d+ free"):
                writer.seal()
        assert writer.seal().read_bytes() == episode_bytes(episode)


def test_an_interrupt_while_sealing_neither_crashes_nor_loses_anything(dataset):
    """Ctrl-C must not surface inside HDF5, which would end the process."""
    truth = make_episode(steps=150, size=40).arrays
    rng = np.random.default_rng(0)

    def seal_until_interrupted(sealing) -> int:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            with start(dataset, make_episode(steps=150, size=40), flush_s=0.0) as writer:
                append_all(writer, truth)
                os.write(sealing, b"x")
                writer.seal()
        except KeyboardInterrupt:
            return 5
        finally:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # what comes later meets a process that has done its work
        return 0

    ends: Counter[int] = Counter()
    for _ in range(INTERRUPTS):
        told, sealing = os.pipe()
        child = fork(partial(seal_until_interrupted, sealing))
        os.read(told, 1)
        time.sleep(rng.uniform(0, 0.3))
        os.kill(child, signal.SIGINT)
        ends[exit_code(child)] += 1
        os.close(told)
        os.close(sealing)
        assert ends.keys() <= {0, 5}
        repair_dataset(dataset.path)
        assert list((dataset.path / INFLIGHT).iterdir()) == []
    for index in dataset.indices:
        assert_same(read_episode(dataset.episode_path(index)).arrays, truth)
    assert len(dataset) == INTERRUPTS
    report("interrupts while sealing", {f"ended {end}": count for end, count in ends.items()})


@pytest.mark.parametrize("stage", ["before", "after"])
def test_an_interrupt_while_recording_neither_doubles_nor_loses_rows(dataset, monkeypatch, stage):
    """Whatever Ctrl-C hits, the rows of an append are stored once or not at all."""
    episode = make_episode()
    with start(dataset) as writer:
        store, left = writer._journal.append, [3]

        def interrupted(label, content=b""):
            left[0] -= 1
            if left[0] == 0 and stage == "before":
                raise KeyboardInterrupt
            store(label, content)
            if left[0] == 0:
                raise KeyboardInterrupt

        append_all(writer, episode.arrays, rng=np.random.default_rng(3))
        wrench = {name: episode.arrays[f"streams/wrench/{name}"][-5:] for name in ("t_ns", "wrench")}
        writer.append("extra/again", **wrench)
        with monkeypatch.context() as patched:
            patched.setattr(writer._journal, "append", interrupted)
            with pytest.raises(KeyboardInterrupt):
                writer.flush()
        path = writer.seal()
    own = {f"extra/again/{name}": array for name, array in wrench.items()}
    assert path.read_bytes() == episode_bytes(Episode(episode.meta, episode.arrays | own))


def unfinished(dataset, episode) -> Path:
    """The journal of a writer that is gone."""
    with start(dataset, episode, flush_s=0.0) as writer:
        for _ in step_by_step(writer, episode.arrays):
            pass
        return writer._journal.path


def test_a_journal_cut_anywhere_gives_back_what_was_before(dataset):
    episode = make_episode(steps=20)
    journal = unfinished(dataset, episode)
    whole = journal.read_bytes()
    counts: Counter[str] = Counter()
    lengths = []
    for position in np.linspace(0, len(whole) - 1, CUTS).astype(int):
        journal.write_bytes(whole[:position])
        (action,) = repair_dataset(dataset.path)
        counts[action.done] += 1
        if action.done == "salvaged":
            saved = read_episode(action.path)
            assert_prefix(saved.arrays, episode.arrays)
            assert saved.meta.annotations == episode.meta.annotations
            lengths.append((position, len(saved)))
        action.path.unlink()
    assert [length for _, length in sorted(lengths)] == sorted(length for _, length in lengths)
    assert max(length for _, length in lengths) >= 19  # all but the step that was cut
    report("cut journals", counts)


def records_of(content: bytes) -> list[tuple[int, int, dict]]:
    """First byte, byte after the last, and label of every record of an intact journal."""
    records, at = [], 0
    while at < len(content):
        _, label, size, _ = HEADER.unpack_from(content, at)
        start = at + HEADER.size
        records.append((at, start + label + size, json.loads(content[start : start + label])))
        at = start + label + size
    return records


def rows_of(label: dict) -> range:
    return range(label["start"], label["start"] + label["shape"][0]) if "start" in label else range(0)


def test_repair_keeps_every_whole_record_around_a_damaged_one(dataset):
    """Of a group the rows that all its streams have, of the steps the longest run; gaps where rows are missing."""
    episode = make_episode(steps=20)
    journal = unfinished(dataset, episode)
    whole, rng = journal.read_bytes(), np.random.default_rng(0)
    records = records_of(whole)
    for number in np.unique(np.linspace(1, len(records) - 1, CUTS).astype(int)):
        first, after, label = records[number]
        journal.write_bytes(
            whole[:first] + flipped(whole[first:after], int(rng.integers(after - first)), rng) + whole[after:]
        )
        (action,) = repair_dataset(dataset.path)
        path, lost = label.get("path", ""), rows_of(label)
        group = path.rpartition("/")[0]
        if not lost and action.done == "quarantined":  # a constant, without which there is no episode
            (dataset.path / "damaged" / journal.name).unlink()
            continue
        saved = read_episode(action.path)
        assert not saved.meta.success
        clocked = {one for one in saved.arrays if one.startswith(("streams/", "cameras/")) and saved.arrays[one].ndim}
        for one in clocked & {known for _, _, record in records if rows_of(record) for known in [record["path"]]}:
            truth = episode.arrays[one]
            same = one.rpartition("/")[0] == group
            np.testing.assert_array_equal(saved.arrays[one], np.delete(truth, list(lost), 0) if same else truth)
        gaps = [one["stream"] for one in saved.meta.annotations if one["name"] == "gap"]
        missing = lost and lost[-1] + 1 < len(episode.arrays[path]) and group.startswith(("streams/", "cameras/"))
        assert gaps == ([group] if missing else [])
        if group in ("observations", "actions"):
            before, behind = lost[0] - (group == "observations"), 20 - lost[0] - 1
            kept = slice(0, before) if before >= behind else slice(lost[0] + 1, 20)
            np.testing.assert_array_equal(saved.action, episode.action[kept])
            np.testing.assert_array_equal(saved.t_ns, episode.t_ns[kept.start : kept.stop + 1])
        else:
            np.testing.assert_array_equal(saved.action, episode.action)
        if after < len(whole):
            assert (dataset.path / "damaged" / journal.name).exists()
            (dataset.path / "damaged" / journal.name).unlink()
        action.path.unlink()


def flipped(content: bytes, position: int, rng: np.random.Generator) -> bytes:
    damaged = bytearray(content)
    damaged[position] ^= 1 << int(rng.integers(8))
    return bytes(damaged)


def test_a_living_writer_is_left_alone(dataset):
    with start(dataset) as writer:
        (action,) = repair_dataset(dataset.path)
        assert (action.done, repair_exit_code([action])) == ("in use", 0)
        append_all(writer, make_episode().arrays)
        writer.seal()
    assert repair_dataset(dataset.path) == []


def test_an_episode_published_just_before_the_power_went_is_not_doubled(dataset, monkeypatch):
    def power_cut(_):
        raise OSError(5, "Input/output error")

    with start(dataset) as writer:
        append_all(writer, make_episode().arrays)
        with monkeypatch.context() as cut:
            cut.setattr(index_locks, "sync_folder", power_cut)
            with pytest.raises(StorageError, match=r"episode_000000\.hdf5.*Input/output error"):
                writer.seal()
    (action,) = repair_dataset(dataset.path)
    assert (action.done, repair_exit_code([action])) == ("cleared", 0)
    assert dataset.indices == [0]
    assert list((dataset.path / INFLIGHT).iterdir()) == []


def test_an_index_that_someone_took_meanwhile_is_given_up(dataset):
    recorded, intruder = make_episode(0), make_episode(0, seed=5)
    unfinished(dataset, recorded)
    write_episode(intruder, dataset.episode_path(0))
    (action,) = repair_dataset(dataset.path)
    assert (action.done, action.path) == ("salvaged", dataset.episode_path(1))
    assert_same(read_episode(dataset.episode_path(0)).arrays, intruder.arrays)
    assert read_episode(dataset.episode_path(1)).meta.index == 1


def with_h5py(change):
    """A mutation that other software could make; sealed again, so that nothing but the content can give it away."""

    def mutate(path: Path, rng: np.random.Generator) -> None:
        with h5py.File(path, "a") as file:
            change(file, rng)
        content = path.read_bytes()
        path.write_bytes(content + seal(content))

    mutate.__name__ = change.__name__
    return mutate


def any_declared(file, rng) -> str:
    paths: list[str] = []
    file.visititems(lambda path, item: paths.append(path) if isinstance(item, h5py.Dataset) else None)
    return paths[rng.integers(len(paths))]


@with_h5py
def other_dtype(file, rng):
    path = any_declared(file, rng)
    attributes, array = dict(file[path].attrs), file[path][()]
    del file[path]
    file[path] = np.asarray(array, np.float16 if array.dtype != np.float16 else np.float32)
    file[path].attrs.update(attributes)


@with_h5py
def other_shape(file, rng):
    path = any_declared(file, rng)
    attributes, array = dict(file[path].attrs), file[path][()]
    del file[path]
    file[path] = np.asarray(array)[..., None]
    file[path].attrs.update(attributes)


@with_h5py
def other_unit(file, rng):
    path = any_declared(file, rng)
    while path.startswith("actions/"):  # the robot that is commanded declares these, in any unit
        path = any_declared(file, rng)
    file[path].attrs["unit"] = "furlong"


@with_h5py
def not_a_number(file, rng):
    file["streams/wrench/wrench"][rng.integers(100), 3] = [np.nan, np.inf][rng.integers(2)]


@with_h5py
def lost_stream(file, rng):
    needed = ["actions", "streams/wrench/t_ns", "cameras/front/t_ns", "observations/t_ns"]
    del file[needed[rng.integers(len(needed))]]


@with_h5py
def group_instead(file, rng):
    path = ["actions/action", "streams/wrench/wrench", "workspace"][rng.integers(3)]
    del file[path]
    file.create_group(path)


@with_h5py
def lost_attribute(file, rng):
    names = sorted(file.attrs)
    del file.attrs[names[rng.integers(len(names))]]


@with_h5py
def wrong_attribute(file, rng):
    names = sorted(file.attrs)
    name = names[rng.integers(len(names))]
    texts = ("task", "source", "robot", "operator", "instruction")
    wrong = [np.arange(3), 2.5] if name in texts else [np.arange(3), 2.5, "{", "3"]
    file.attrs[name] = wrong[rng.integers(len(wrong))]


@with_h5py
def other_major_version(file, rng):
    file.attrs["format_version"] = f"{[1, 3, 4, 5][rng.integers(4)]}.0"


def truncated(path, rng):
    os.truncate(path, rng.integers(path.stat().st_size))


def bit_flipped(path, rng):
    content = path.read_bytes()
    path.write_bytes(flipped(content, int(rng.integers(len(content))), rng))


def bytes_replaced(path, rng):
    content = bytearray(path.read_bytes())
    start = int(rng.integers(len(content) - 64))
    content[start : start + 64] = bytes(255 - byte for byte in content[start : start + 64])
    path.write_bytes(content)


def sector_lost(path, rng):
    content = bytearray(path.read_bytes())
    start = 512 * int(rng.integers(len(content) // 512))
    content[start : start + 512] = bytes(512) if any(content[start : start + 512]) else b"x" * 512
    path.write_bytes(content)


def appended(path, rng):
    path.write_bytes(path.read_bytes() + rng.bytes(int(rng.integers(1, 200))))


def seal_of_another(path, rng):
    path.write_bytes(path.read_bytes()[:-SEAL_SIZE] + seal(rng.bytes(9)))


def emptied(path, rng):
    path.write_bytes(b"")


def text_renamed(path, rng):
    path.write_text("time,fx,fy\n" * int(rng.integers(1, 900)))


def foreign(path, rng):
    path.unlink()
    with h5py.File(path, "w") as file:
        file[f"data/demo_{rng.integers(9)}/actions"] = np.zeros((3, 7))


@with_h5py
def foreign_but_sealed(file, rng):
    for name in list(file):
        del file[name]
    file[f"data/demo_{rng.integers(9)}/actions"] = np.zeros((3, 7))


MUTATE = [
    truncated, bit_flipped, bit_flipped, bit_flipped, bytes_replaced, sector_lost, appended, seal_of_another, emptied,
    text_renamed, foreign, foreign_but_sealed, other_dtype, other_shape, other_unit, not_a_number, lost_stream,
    group_instead, lost_attribute, wrong_attribute, other_major_version,
]  # fmt: skip


def test_a_mutated_file_is_always_an_error_of_ours(tmp_path):
    """No crash (the child lives), no hang (it has an alarm), no traceback of others, nothing read as if intact."""
    path = tmp_path / "episode_000000.hdf5"
    whole = episode_bytes(make_episode())

    def mutate_and_read() -> int:
        rng = np.random.default_rng(0)
        slowest = 0.0
        for number in range(MUTATIONS):
            mutation = MUTATE[number % len(MUTATE)]
            path.write_bytes(whole)
            mutation(path, rng)
            signal.alarm(int(PATIENCE))
            begin = time.perf_counter()
            try:
                read_episode(path)
            except (FormatError, FieldError) as error:
                if str(path) not in str(error) or "\n" in str(error):
                    print(mutation.__name__, "unclear:", error)
                    return 2
            else:
                print(mutation.__name__, "read as if intact")
                return 1
            slowest = max(slowest, time.perf_counter() - begin)
        report("mutated files", {"read": MUTATIONS, "kinds": len(set(MUTATE)), "ms slowest": round(1000 * slowest)})
        return 0

    assert in_child(mutate_and_read) == 0


def test_repair_sets_damage_aside_and_seals_what_is_valid(dataset):
    for index in range(5):
        write_episode(make_episode(index), dataset.episode_path(index))
    rng = np.random.default_rng(0)
    truncated(dataset.episode_path(1), rng)
    bit_flipped(dataset.episode_path(2), rng)
    for index, temperature in ((3, 20.0), (4, np.nan)):
        with h5py.File(dataset.episode_path(index), "a") as file:
            file["extra/temperature"] = temperature
            file["streams/wrench/wrench"][0, 0] = temperature
    damaged = {index: dataset.episode_path(index).read_bytes() for index in (1, 2, 4)}
    actions = repair_dataset(dataset.path, reseal=True)
    assert [action.done for action in actions] == ["quarantined", "quarantined", "resealed", "quarantined"]
    assert repair_exit_code(actions) == 3
    assert dataset.indices == [0, 3]
    assert read_episode(dataset.episode_path(3)).arrays["extra/temperature"] == 20.0
    assert read_episode(dataset.episode_path(3)).meta.history == [{"tool": "repair", "resealed": True}]
    for index, content in damaged.items():
        assert (dataset.path / "damaged" / f"episode_{index:06d}.hdf5").read_bytes() == content
    assert repair_dataset(dataset.path, reseal=True) == []


def test_without_asking_nothing_is_sealed_again(dataset):
    write_episode(make_episode(), dataset.episode_path(0))
    with h5py.File(dataset.episode_path(0), "a") as file:
        file.attrs["success"] = False
    (action,) = repair_dataset(dataset.path)
    assert (action.done, repair_exit_code([action])) == ("quarantined", 1)


def test_damaged_files_of_one_name_are_all_kept(dataset):
    for text in ("first", "second", "third"):
        dataset.episode_path(0).write_text(text)
        repair_dataset(dataset.path)
    kept = {file.read_text() for file in (dataset.path / "damaged").iterdir()}
    assert kept == {"first", "second", "third"}


def test_an_episode_salvaged_before_its_first_action_has_none(dataset):
    arrays = make_episode().arrays
    with EpisodeWriter(dataset, replace(make_episode().meta, index=NEXT), constants_of(arrays)) as writer:
        writer.append("observations", t_ns=arrays["observations/t_ns"][:1], proprio=arrays["observations/proprio"][:1])
    (action,) = repair_dataset(dataset.path)
    saved = read_episode(action.path)
    assert (len(saved), saved.has("wrench"), saved.cameras) == (0, False, {})
