"""One law per check, both sides: clean episodes pass, a spoiled one is found and named with its place."""

import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from svfl_data.checks import check_dataset, check_episode, check_file
from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.action_fields import planar_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.store import write_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.open_episode import BARE, OWN, bare_episode, open_arrays
from tests.helpers.spoiled import (
    COLOR,
    DEPTH,
    FRAMES,
    SPOILERS,
    TARE,
    WRENCH,
    WRENCH_T,
    backward_time,
    camera_clock_set_forward,
    clock_set_back,
    clock_set_forward,
    duplicate_time,
    fresh,
    gap,
    jitter,
)

PERIOD = 2_000_000


def findings(arrays, config=None, task="centering", declarations=(), **meta):
    made = Meta(task, 0, 0, "expert", True, config or {}, **meta)
    return check_episode(Episode(made, arrays, "e.hdf5", Declarations(declarations)))


def test_a_clean_episode_has_no_findings():
    assert findings(fresh()) == []
    assert check_episode(make_episode(3)) == []


def test_jitter_of_a_good_clock_and_any_other_rate_are_clean():
    arrays = fresh()
    rng = np.random.default_rng(1)
    arrays[WRENCH_T] = arrays[WRENCH_T] + rng.integers(-50_000, 50_000, len(arrays[WRENCH_T]))
    arrays[FRAMES] = np.linspace(190_000_000, 1_300_000_000, 21).astype(np.int64)
    assert findings(arrays) == []


@pytest.mark.parametrize("spoil", SPOILERS, ids=lambda spoil: spoil.__name__)
def test_what_is_spoiled_is_found_and_named(spoil):
    arrays = fresh()
    field, index, severity, words = spoil(arrays)
    found = findings(arrays)
    assert len([finding for finding in found if words in finding.words]) == 1, found
    (finding,) = (finding for finding in found if words in finding.words)
    assert (finding.episode, finding.field, finding.severity) == ("e.hdf5", field, severity)
    assert index is None or finding.index == index


TIMES = [duplicate_time, backward_time, clock_set_back, clock_set_forward, camera_clock_set_forward, gap, jitter]


@pytest.mark.parametrize("spoil", TIMES, ids=lambda spoil: spoil.__name__)
def test_what_is_wrong_with_a_clock_has_one_name(spoil):
    names = ("duplicate", "backward", "stepped clock", "gaps", "jitter")
    arrays = fresh()
    _, _, _, words = spoil(arrays)
    said = {name for name in names for finding in findings(arrays) if finding.words.startswith(name)}
    own = {name for name in names if words.startswith(name)}
    # The neighbours of a repeated or swapped reading are also too far from the next one.
    assert own <= said <= own | ({"gaps"} if spoil in (duplicate_time, backward_time) else set())


def test_noise_free_readings_at_rest_are_noted_but_no_error():
    arrays = fresh()
    arrays["observations/proprio"][:] = arrays["observations/proprio"][0]
    arrays[WRENCH][:] = [0, 0, -8, 0.01, 0.02, 0]
    assert {finding.severity for finding in findings(arrays)} == {"note"}


def test_a_steady_load_without_noise_is_not_saturation():
    arrays = fresh()
    arrays["observations/proprio"][:] = arrays["observations/proprio"][0]
    arrays[WRENCH][:] = arrays[TARE]
    arrays[WRENCH][300:] += np.float32(40)
    assert {finding.severity for finding in findings(arrays)} == {"note"}


def test_irregular_streams_are_jittery_not_full_of_gaps():
    arrays = fresh()
    t_ns = np.cumsum(np.random.default_rng(0).exponential(PERIOD, 580)).astype(np.int64)
    arrays[WRENCH_T] = np.unique(np.append(t_ns, arrays["observations/t_ns"][-1]))
    arrays[WRENCH] = np.resize(arrays[WRENCH], (len(arrays[WRENCH_T]), 6))
    (found,) = (finding for finding in findings(arrays) if finding.field == WRENCH_T)
    assert "jitter" in found.words


def test_actions_are_checked_by_the_bounds_that_their_array_declares():
    arrays = fresh()
    arrays["actions/action"][6, 2] = 0.04
    assert findings(dict(arrays), declarations=[planar_action(0.05, 0.2)]) == []
    arrays["actions/action"] = arrays["actions/action"] * np.float32([1, 1.5, 1.5, 1.5, 1])
    (found,) = findings(dict(arrays), declarations=[planar_action(0.05, 0.2)])
    assert (found.severity, found.index) == ("error", 6)
    assert re.search(r"-0\.05 to 0\.05 m.*declared", found.words)
    assumed = replace(planar_action(0.05, 0.2), assumed=("bounds",))
    beyond, said = findings(arrays, declarations=[assumed])
    assert (beyond.severity, said.severity) == ("warning", "warning")
    assert "assumed bounds" in beyond.words
    assert said.words.startswith("bounds are assumed")


def test_joint_commands_have_names_units_and_bounds_of_their_own():
    episode = bare_episode()
    action = np.array(episode.action)
    action[3, 4] = 4.0
    (found,) = check_episode(Episode(episode.meta, episode.arrays | {"actions/action": action}, declarations=BARE))
    assert (found.field, found.index, found.severity) == ("actions/action", 3, "error")
    assert "wrist_2 is 4 rad, outside -3.2 to 3.2 rad" in found.words


def of_open(**changes):
    """Findings of the many-sensor episode with some arrays changed; None leaves an array out."""
    changed = {path.replace("__", "/"): array for path, array in changes.items()}
    arrays = {path: np.array(array) for path, array in (open_arrays() | changed).items() if array is not None}
    found = check_episode(Episode(Meta("cups", 0, 0, "teleop", True), arrays, declarations=OWN))
    return [(one.field, one.severity, one.words) for one in found]


def test_an_episode_without_a_tare_or_with_assumptions_is_warned_of_and_nothing_else():
    assert [(field, severity, words.partition(";")[0].partition(":")[0]) for field, severity, words in of_open()] == [
        ("streams/left_finger/wrench", "warning", "has no tare"),
        ("observations/tcp_velocity", "warning", "axes are assumed"),
        ("observations/tcp_velocity", "warning", "parts are assumed"),
    ]
    assert check_episode(bare_episode()) == []


def test_every_wrench_sensor_is_checked_not_only_the_first():
    wrench = open_arrays()["streams/left_finger/wrench"].copy()
    wrench[20:60] = wrench[20]
    found = of_open(streams__left_finger__wrench=wrench)
    assert ("streams/left_finger/wrench", "error") in [(field, severity) for field, severity, _ in found]
    assert any("stuck sensor: 40 identical readings" in words for _, _, words in found)
    wrench[20:60, 0] = 80.0
    wrench[20:60, 1] = np.arange(40)
    found = of_open(streams__left_finger__wrench=wrench)
    assert any("fx is saturated: 40 readings" in words for _, _, words in found)


def test_a_gap_of_an_own_stream_is_found():
    arrays = open_arrays()
    kept = np.delete(np.arange(101), slice(40, 50))
    found = of_open(
        streams__tactile__t_ns=arrays["streams/tactile/t_ns"][kept],
        streams__tactile__pressure=arrays["streams/tactile/pressure"][kept],
    )
    assert any(field == "streams/tactile/t_ns" and words.startswith("gaps") for field, _, words in found)


def test_grey_images_are_looked_at_like_colour():
    color = open_arrays()["cameras/wrist/color"]
    grey = color[..., 0].astype(np.uint16)
    assert len(of_open(cameras__wrist__color=None, cameras__wrist__grey16=grey)) == len(of_open())
    grey[3] = 7
    found = of_open(cameras__wrist__color=None, cameras__wrist__grey16=grey)
    assert ("cameras/wrist/grey16", "error") in [(field, severity) for field, severity, _ in found]


def test_the_pose_of_a_camera_that_moves_is_checked():
    found = of_open(streams__tcp__pose=None, streams__tcp__t_ns=None)
    assert any(field == "cameras/wrist/T_tcp_camera" and "streams/tcp/pose is missing" in w for field, _, w in found)
    late = open_arrays()["streams/tcp/t_ns"][100:], open_arrays()["streams/tcp/pose"][100:]
    found = of_open(streams__tcp__t_ns=late[0], streams__tcp__pose=late[1])
    assert any("2 of 11 frames lie before the first pose" in words for _, _, words in found)
    poses = np.tile(np.eye(4), (11, 1, 1))
    moving = {"cameras__wrist__T_tcp_camera": None, "cameras__wrist__T_base_camera_per_frame": poses}
    assert any("the pose never changes, while the gripper moved by" in words for _, _, words in of_open(**moving))
    poses[:, 0, 3] = np.linspace(0, 0.1, 11)
    assert len(of_open(**moving)) == len(of_open())
    poses[6:, 1, 3] = 5.0
    assert any("the camera jumps by 5 m at row 6" in words for _, _, words in of_open(**moving))


def test_tasks_without_labels_need_none():
    arrays = fresh()
    del arrays["labels/direction"], arrays["labels/offset"]
    assert findings(arrays, task="picking") == []
    (found,) = findings(arrays)
    assert re.search(r"missing.*offset.*direction", found.words)


@pytest.mark.parametrize(
    ("annotation", "said"),
    [
        ({"name": "contact", "start_ns": 5, "end_ns": 3}, "not within the episode"),
        ({"name": "contact", "start_ns": 0, "end_ns": 10**12}, "not within the episode"),
        ({"start_ns": 0, "end_ns": 1}, "needs a name"),
        ({"name": "contact", "start_ns": 0.5, "end_ns": 1}, "integers"),
    ],
)
def test_annotations_lie_within_the_episode(annotation, said):
    good = {"name": "contact", "start_ns": 0, "end_ns": 10**9}
    assert findings(fresh(), annotations=[good]) == []
    (found,) = findings(fresh(), annotations=[good, annotation])
    assert (found.field, found.index, found.severity) == ("annotations", 1, "error")
    assert said in found.words


def test_a_transform_that_cannot_be_applied_is_found():
    assert findings(fresh(), transforms=[{"name": "tare"}, {"name": "low_pass", "cutoff_hz": 20}]) == []
    (found,) = findings(fresh(), transforms=[{"name": "kalman"}])
    assert (found.field, found.severity) == ("transforms", "error")


def test_every_check_is_harmless_on_the_shortest_episode():
    arrays = fresh(steps=0)
    for path in (WRENCH_T, WRENCH, "streams/object/t_ns", "streams/object/pose", FRAMES, COLOR, DEPTH):
        arrays[path] = arrays[path][:0]
    assert {finding.severity for finding in findings(arrays)} <= {"warning", "note"}


def test_a_damaged_file_is_one_error_that_names_it(tmp_path):
    path = tmp_path / "episode_000000.hdf5"
    write_episode(make_episode(), path)
    assert check_file(path) == []
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    (found,) = check_file(path)
    assert (found.episode, found.severity) == (str(path), "error")
    assert "damaged" in found.words
    (found,) = check_file(tmp_path / "absent.hdf5")
    assert "no such file" in found.words


def test_what_is_wrong_between_the_episodes_of_a_dataset_is_found(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "data", "centering", 0, {})
    for index in range(3):
        write_episode(make_episode(index), dataset.episode_path(index))
    assert [finding for found in check_dataset(dataset) for finding in found] == []

    write_episode(make_episode(9), dataset.episode_path(3))
    write_episode(make_episode(4, size=8), dataset.episode_path(4))
    bare = {path: array for path, array in make_episode(5).arrays.items() if "joints" not in path}
    write_episode(Episode(Meta("pushing", 5, 0, "expert", True), bare), dataset.episode_path(5))
    dataset.episode_path(6).write_bytes(b"")
    found = [
        (finding.episode[-6], finding.field) for found in check_dataset(Dataset.open(dataset.path)) for finding in found
    ]
    assert set(found) == {
        ("3", "index"), ("4", COLOR), ("4", DEPTH), ("5", "streams/joints/position"), ("5", "streams/joints/t_ns"),
        ("5", "task"), ("6", ""),
    }  # fmt: skip


@pytest.mark.parametrize("angle", np.deg2rad([10, 40, 100, 130, 190, 220, 280, 310]))
def test_only_the_nearest_direction_agrees_with_the_offset(angle):
    arrays = episode_arrays(np.random.default_rng(0), angle=angle)
    nearest = int(arrays["labels/direction"])
    for direction in range(4):
        found = findings(arrays | {"labels/direction": np.array(direction)})
        assert bool(found) == (direction != nearest)


@pytest.mark.parametrize("noise", ["realistic", "none"])
def test_what_the_collectors_write_has_no_findings(noise):
    from collectors.simulation.config import WorldConfig
    from collectors.simulation.noise import NoiseConfig
    from collectors.sources.centering import CenteringCollector

    world = WorldConfig(noise=NoiseConfig() if noise == "realistic" else NoiseConfig.none())
    assert check_episode(CenteringCollector(seed=11, world=world)(0)) == []


def flipped(path: Path, position: int) -> None:
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("array", ["streams/wrench/wrench", "cameras/front/depth", "observations/proprio"])
def test_a_damaged_file_is_found_and_the_stream_named(tmp_path, array):
    path = tmp_path / "e.hdf5"
    write_episode(make_episode(), path)
    with h5py.File(path) as file:
        chunk = file[array].id.get_chunk_info(0)
    flipped(path, chunk.byte_offset + chunk.size // 2)
    seal, *streams = check_file(path)
    assert "do not match its seal" in seal.words
    assert [finding.field for finding in streams] == [array]


def test_a_file_of_other_software_is_not_blamed_for_every_stream(tmp_path):
    with h5py.File(tmp_path / "foreign.hdf5", "w") as file:
        file["data/demo_0/actions"] = np.zeros((3, 7))
    (finding,) = check_file(tmp_path / "foreign.hdf5")
    assert "other software" in finding.words
