"""What episodes of a dataset share is compared in one place, and follows from the episodes that there are."""

import multiprocessing
import shutil
from dataclasses import replace

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import INDEX
from svfl_data.errors import DatasetError
from svfl_data.maintenance.merge import merge
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.consistency import check_agreement
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.sampling.samples import Samples
from svfl_data.schema.declarations import STANDARD
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.store import write_episode
from tests.helpers.builders import episode_arrays, make_episode

pytestmark = pytest.mark.slow

POSE = "cameras/front/T_base_camera"


def arrays_of(seed=0, **kwargs):
    return episode_arrays(np.random.default_rng(seed), **kwargs)


def start(dataset, arrays, **kwargs):
    meta = Meta("centering", NEXT, 0, "robot", False)
    constants = {path: array for path, array in arrays.items() if not STANDARD.at(path).grows}
    return EpisodeWriter(dataset, meta, constants, **kwargs)


def append(writer, arrays):
    groups: dict[str, dict[str, np.ndarray]] = {}
    for path, array in arrays.items():
        if STANDARD.at(path).grows:
            group, _, name = path.rpartition("/")
            groups.setdefault(group, {})[name] = array
    for group, columns in groups.items():
        writer.append(group, **columns)


def record(dataset, arrays, **kwargs):
    with start(dataset, arrays, **kwargs) as writer:
        append(writer, arrays)
        return writer.seal(success=True)


def changed(path, change):
    def arrays(seed):
        made = arrays_of(seed)
        made[path] = change(made[path].copy())
        return made

    return arrays


def moved_by(metres):
    def change(pose):
        pose[0, 3] += metres
        return pose

    return change


QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def without(*paths):
    return lambda seed: {path: array for path, array in arrays_of(seed).items() if path not in paths}


def wrist_too(seed):
    made = arrays_of(seed)
    return made | {
        path.replace("front", "wrist"): array.copy() for path, array in made.items() if path.startswith("cameras/")
    }


def more_joints(seed):
    made = arrays_of(seed)
    return made | {"streams/joints/position": made["streams/joints/position"][:, :7].copy()}


OTHERS = {
    "turned camera": (changed(POSE, lambda pose: np.block([[QUARTER @ pose[:3, :3], pose[:3, 3:]], [pose[3:]]])), POSE),
    "moved by 0.1 mm": (changed(POSE, moved_by(1e-4)), POSE),
    "axes": (changed("cameras/front/image_axes", lambda axes: axes[::-1].copy()), "cameras/front/image_axes"),
    "lens": (changed("cameras/front/intrinsics", lambda lens: lens + np.diag([1, 1, 0])), "cameras/front/intrinsics"),
    "depth scale": (changed("cameras/front/depth_scale", lambda scale: scale * 10), "cameras/front/depth_scale"),
    "workspace": (changed("workspace", lambda bounds: bounds + 0.1), "workspace"),
    "image size": (lambda seed: arrays_of(seed, size=20), "cameras/front/color"),
    "no depth": (without("cameras/front/depth", "cameras/front/depth_scale"), "cameras/front/depth"),
    "two cameras": (wrist_too, "cameras/wrist"),
    "joints": (more_joints, "streams/joints/position"),
}


@pytest.fixture
def dataset(tmp_path):
    return Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})


@pytest.mark.parametrize("kind", OTHERS)
def test_one_comparison_serves_everybody(dataset, tmp_path, kind, command):
    """The writer, merge, filter, validate, check_agreement and samples refuse the same, and name it."""
    make, name = OTHERS[kind]
    record(dataset, arrays_of(0))
    with pytest.raises(DatasetError, match=f"{name}.*episode 0"):
        record(dataset, make(1))
    shutil.rmtree(dataset.path / ".inflight")

    other = Dataset.create_or_resume(tmp_path / "other", "centering", 0, {})
    write_episode(Episode(make_episode(1).meta, make(1)), other.episode_path(1))
    with pytest.raises(DatasetError, match=rf"{name}.*other/episode_000001.*d/episode_000000.*--varies {name}"):
        merge([dataset, other], tmp_path / "all")
    assert not (tmp_path / "all").exists()

    shutil.copy(other.episode_path(1), dataset.path)  # past all that would have refused it
    with pytest.raises(DatasetError, match=name):
        check_agreement(dataset, dataset.indices)
    wrong_first = {"axes": "labels/direction", "two cameras": "--camera.*front, wrist"}
    with pytest.raises(DatasetError, match=wrong_first.get(kind, name)):
        load_centering(dataset.path)
    if kind != "joints":
        used = ["front"]
        if kind == "two cameras":
            assert len(Samples(dataset, cameras=used))  # what is not used does not matter
        else:
            with pytest.raises(DatasetError, match=name if kind != "no depth" else "depth"):
                Samples(dataset, cameras=used)
    code, out, err = command("validate", dataset.path)
    assert code == 1
    assert f"error: {dataset.episode_path(1)}: {name}" in out
    code, _, err = command("filter", dataset.path, tmp_path / "few", "--task", "centering")
    assert (code, err.count("\n")) == (1, 1)
    assert name in err
    assert command("filter", dataset.path, tmp_path / "one", "--where", "index=1")[0] == 0  # the way to tell them apart


def test_what_varies_on_purpose_is_carried_along(dataset, tmp_path, command):
    record(dataset, arrays_of(0))
    record(dataset, changed(POSE, moved_by(0.01))(1), varies=[POSE])
    record(dataset, changed(POSE, moved_by(0.02))(2), varies=[POSE])
    assert command("validate", dataset.path)[0] == 0
    check_agreement(dataset, dataset.indices)
    merged = tmp_path / "merged"
    merge([dataset], merged)
    check_agreement(Dataset.open(merged), [0, 1, 2])
    assert command("validate", merged)[0] == 0
    with pytest.raises(DatasetError, match="image_axes"):
        record(dataset, OTHERS["axes"][0](3), varies=[POSE])


def test_merge_lets_differ_what_it_is_told(tmp_path, command):
    for number, day in enumerate(("monday", "tuesday")):
        arrays = changed(POSE, moved_by(number / 1e4))(number)
        record(Dataset.create_or_resume(tmp_path / day, "centering", 0, {}), arrays)
    code, _, err = command("merge", tmp_path / "monday", tmp_path / "tuesday", tmp_path / "week")
    assert code == 1
    assert "1.0001 at [0, 3]" in err
    assert f"--varies {POSE}" in err
    words = ("--varies", POSE)
    assert command("merge", tmp_path / "monday", tmp_path / "tuesday", tmp_path / "week", *words)[0] == 0
    week = Dataset.open(tmp_path / "week")
    assert week.varies == {POSE}
    assert command("validate", week.path)[0] == 0
    code, _, err = command("filter", week.path, tmp_path / "again", "--success", "yes")
    assert (code, err) == (0, "")
    assert Dataset.open(tmp_path / "again").varies == {POSE}


def test_rounding_of_another_processor_is_no_difference(dataset):
    record(dataset, arrays_of(0))
    record(dataset, changed(POSE, lambda pose: pose * (1 + 1e-15))(1))
    check_agreement(dataset, dataset.indices)


@pytest.mark.parametrize("how", ["discard", "delete", "kill"])
def test_what_was_never_sealed_or_is_gone_binds_nobody(dataset, how):
    wrong, right = arrays_of(0, size=20), changed(POSE, moved_by(0.1))(1)
    if how == "delete":
        record(dataset, wrong).unlink()
    else:
        writer = start(dataset, wrong)
        append(writer, wrong)
        writer.discard() if how == "discard" else writer.__exit__(None, None, None)
    record(dataset, right)
    record(dataset, changed(POSE, moved_by(0.1))(2))
    assert len(dataset) == 2


def test_an_index_that_is_gone_changes_nothing(dataset):
    record(dataset, arrays_of(0))
    (dataset.path / INDEX).unlink()
    with pytest.raises(DatasetError, match=POSE):
        record(dataset, changed(POSE, moved_by(0.1))(1))


def test_of_two_that_start_at_once_the_second_is_told_at_once(dataset):
    first = start(dataset, arrays_of(0))
    with pytest.raises(DatasetError, match=f"{POSE}.*episode_000000.*being recorded"):
        start(dataset, changed(POSE, moved_by(0.1))(1))
    append(first, arrays_of(0))
    (dataset.path / ".inflight" / "episode_000000.part").touch()  # what sealing writes, which nobody locks
    second = start(dataset, arrays_of(1))
    with pytest.raises(DatasetError, match="cameras/front/color"):
        append(second, arrays_of(1, size=20))
    second.discard()
    first.seal(success=True)
    assert dataset.indices == [0]
    assert not list((dataset.path / ".inflight").iterdir())


def test_a_refused_seal_loses_nothing(dataset, tmp_path, command):
    """Episodes of another setup came from elsewhere meanwhile."""
    mine = arrays_of(0)
    with start(dataset, mine) as writer:
        append(writer, mine)
        other = replace(make_episode(7).meta, index=7)
        write_episode(Episode(other, changed(POSE, moved_by(0.1))(7)), dataset.episode_path(7))
        with pytest.raises(DatasetError, match=f"{POSE}.*episode 7.*svfl-data repair"):
            writer.seal(success=True)
    (action,) = repair_dataset(dataset.path)
    assert action.saved
    np.testing.assert_array_equal(dataset.read(action_index(action)).wrench, mine["streams/wrench/wrench"])
    assert command("filter", dataset.path, tmp_path / "mine", "--where", "index!=7")[0] == 0


def action_index(action):
    return int(action.path.stem.rpartition("_")[2])


def record_many(folder, seed, metres, barrier, sealed):
    barrier.wait(60)
    for turn in range(3):
        try:
            record(Dataset.open(folder), changed(POSE, moved_by(metres))(seed + turn))
            sealed.put(metres)
        except DatasetError as error:
            sealed.put(str(error))


def test_processes_that_disagree_never_mix(dataset):
    """Whoever is first to record wins; the others are told; nothing of another setup is sealed."""
    context = multiprocessing.get_context("fork")
    barrier, sealed = context.Barrier(4), context.Queue()
    writers = [
        context.Process(target=record_many, args=(dataset.path, 10 * number, number % 2 / 10, barrier, sealed))
        for number in range(4)
    ]
    for writer in writers:
        writer.start()
    outcomes = [sealed.get(timeout=120) for _ in range(12)]
    for writer in writers:
        writer.join(60)
        assert writer.exitcode == 0
    won = {outcome for outcome in outcomes if not isinstance(outcome, str)}
    assert len(won) == 1
    assert all(POSE in outcome for outcome in outcomes if isinstance(outcome, str))
    check_agreement(dataset, dataset.indices)
    assert len(dataset) == sum(not isinstance(outcome, str) for outcome in outcomes)
    assert not list((dataset.path / ".inflight").iterdir())
