"""One law per check, both sides: clean episodes pass, a spoiled one is found and named with its place."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from svfl_data.checks import CHECKS, check_dataset, check_episode, check_file
from svfl_data.dataset import Dataset
from svfl_data.episode import Episode, Meta
from svfl_data.store import write_episode
from tests.builders import episode_arrays, make_episode

WRENCH_T, WRENCH, TARE = "streams/wrench/t_ns", "streams/wrench/wrench", "streams/wrench/tare"
FRAMES, COLOR, DEPTH = "cameras/front/t_ns", "cameras/front/color", "cameras/front/depth"
PERIOD = 2_000_000


def fresh(steps=20):
    arrays = episode_arrays(np.random.default_rng(0), steps=steps)
    arrays["observations/proprio"][:, 1] = np.linspace(0.4, 0.6, steps + 1)  # the hand moves
    return arrays


def findings(arrays, config=None, task="centering", **meta):
    return check_episode(Episode(Meta(task, 0, 0, "expert", True, config or {}, **meta), arrays, name="e.hdf5"))


def test_a_clean_episode_has_no_findings():
    assert findings(fresh()) == []
    assert check_episode(make_episode(3)) == []


def test_jitter_of_a_good_clock_and_any_other_rate_are_clean():
    arrays = fresh()
    rng = np.random.default_rng(1)
    arrays[WRENCH_T] = arrays[WRENCH_T] + rng.integers(-50_000, 50_000, len(arrays[WRENCH_T]))
    arrays[FRAMES] = np.linspace(190_000_000, 1_300_000_000, 21).astype(np.int64)
    assert findings(arrays) == []


# Each spoils one thing and returns the field, index, severity and words of the finding.


def duplicate_time(arrays):
    arrays[WRENCH_T][77] = arrays[WRENCH_T][76]
    return WRENCH_T, 77, "error", "duplicate timestamps at row 77 (0.154 s)"


def backward_time(arrays):
    arrays[WRENCH_T][[80, 81]] = arrays[WRENCH_T][[81, 80]]
    return WRENCH_T, 81, "error", "backward timestamps (out of order) at row 81 (0.162 s)"


def clock_set_back(arrays):
    arrays[WRENCH_T][300:] -= 100_500_000
    return WRENCH_T, 300, "error", "stepped clock: set by -100.5 ms at row 300 (0.501 s)"


def clock_set_forward(arrays):
    arrays[WRENCH_T][300:] += 1_000_000_000
    return WRENCH_T, 300, "error", "stepped clock: set by +1000.0 ms at row 300 (1.602 s)"


def camera_clock_set_forward(arrays):
    arrays[FRAMES][7:] += 500_000_000
    return FRAMES, 7, "error", "stepped clock: set by +500.0 ms at row 7 (1.050 s)"


def gap(arrays):
    arrays[WRENCH_T] = np.delete(arrays[WRENCH_T], slice(100, 105))
    arrays[WRENCH] = np.delete(arrays[WRENCH], slice(100, 105), axis=0)
    return WRENCH_T, 100, "warning", "gaps before row 100 (0.212 s); the widest is 12.0 ms, 6.0 periods of 2 ms"


def jitter(arrays):
    shake = np.random.default_rng(0).integers(-900_000, 900_000, len(arrays[WRENCH_T]))
    shake[[0, -1]] = 0
    arrays[WRENCH_T] = arrays[WRENCH_T] + shake
    return WRENCH_T, None, "warning", "jitter: intervals vary by"


def drop_outs(arrays):
    kept = np.arange(len(arrays[WRENCH_T])) % 20 != 7
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][kept], arrays[WRENCH][kept]
    return WRENCH_T, None, "warning", "(475.0 Hz by mean interval, 500.0 Hz by median)"


def foreign_clock(arrays):
    for path in arrays:
        if path.endswith("t_ns"):
            arrays[path] = arrays[path] + 1_700_000_000 * 10**9
    return "observations/t_ns", 0, "warning", "the clock does not start with the episode"


def late_start(arrays):
    arrays[FRAMES] = arrays[FRAMES] + 10_000_000
    return FRAMES, 0, "warning", "nothing at or before the first observation (0.200 s): starts at 0.210 s"


def early_end(arrays):
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][:400], arrays[WRENCH][:400]
    return WRENCH_T, 399, "warning", "ends at 0.800 s, the last observation is at 1.200 s"


def empty_stream(arrays):
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][:0], arrays[WRENCH][:0]
    return WRENCH_T, None, "warning", "the stream is empty"


def saturation(arrays):
    push = 60 * np.sin(np.linspace(0, np.pi, 200))
    arrays[WRENCH][200:400, 0] += np.minimum(push, 50).astype(np.float32)
    clipped = arrays[WRENCH][200:400, 0]
    arrays[WRENCH][200:400, 0] = np.where(push > 50, 50.0, clipped)
    return WRENCH, 200 + int((push > 50).argmax()), "error", "fx is saturated"


def stuck(arrays):
    arrays[WRENCH][250:350] = arrays[WRENCH][250]
    return WRENCH, 250, "error", "stuck sensor: 100 identical readings in a row from 0.502 s to 0.700 s"


def no_sensor(arrays):
    arrays[WRENCH][:] = 0
    return WRENCH, None, "warning", "every reading is zero"


def tare_missing(arrays):
    arrays[TARE][:] = 0
    return TARE, 2, "warning", "the tare is missing (all zero): fz reads -8 N on average"


def tare_of_another_day(arrays):
    arrays[TARE][4] += 0.5
    return TARE, 4, "warning", "the tare does not fit: my reads 0.02"


def black_image(arrays):
    arrays[COLOR][5:8] = 0
    return COLOR, 5, "error", "3 of 21 images are all black: rows 5 (0.450 s), 6 (0.500 s), 7 (0.550 s)"


def grey_image(arrays):
    arrays[COLOR][5] = 128
    return COLOR, 5, "error", "1 of 21 images are of one grey: row 5 (0.450 s)"


def frozen_picture(arrays):
    arrays[COLOR][4:14] = arrays[COLOR][4]
    return COLOR, 4, "warning", "frozen picture: 10 identical images from 0.400 s to 0.850 s"


def depth_holes(arrays):
    arrays[DEPTH][3, :12] = 0
    return DEPTH, 3, "warning", "depth holes: 1 of 21 images lack more than 50% of their pixels, row 3 (0.350 s)"


def no_depth(arrays):
    arrays[DEPTH][:] = 0
    return DEPTH, 0, "error", "no measurement in any depth image"


def constant_depth(arrays):
    arrays[DEPTH][9] = 5000
    return DEPTH, 9, "error", "1 of 21 depth images are constant"


def action_too_large(arrays):
    arrays["actions/action"][6, 2] = 0.026
    return "actions/action", 6, "error", "dy is 0.026 m, outside -0.025 to 0.025 m (bounds: the paper"


def opening_too_large(arrays):
    arrays["actions/action"][6, 0] = 1.2
    return "actions/action", 6, "error", "opening is 1.2, outside"


def turn_too_large(arrays):
    arrays["actions/action"][0, 4] = -0.3
    return "actions/action", 0, "error", "dtheta is -0.3 rad"


def hand_far_away(arrays):
    arrays["observations/proprio"][9, 3] = 0.5
    return "observations/proprio", 9, "warning", "TCP z = 0.500 m is 250 mm outside the workspace"


def gripper_opening_in_metres(arrays):
    arrays["observations/proprio"][2:, 0] = 80
    return "observations/proprio", 2, "warning", "gripper opening 80 is not within 0 to 1"


def quaternion_not_unit(arrays):
    arrays["streams/object/pose"][4, 3:] *= 1.1
    return "streams/object/pose", 4, "error", "quat_xyzw is not unit: norm 1.1 (1 of 21 poses)"


def camera_pose_not_rigid(arrays):
    arrays["cameras/front/T_base_camera"][0, 0] = 0.5
    return "cameras/front/T_base_camera", None, "error", "not a pose"


def camera_pose_mirrored(arrays):
    arrays["cameras/front/T_base_camera"][:3, 0] *= -1
    return "cameras/front/T_base_camera", None, "error", "not a pose"


def image_axes_stretched(arrays):
    arrays["cameras/front/image_axes"] *= 2
    return "cameras/front/image_axes", None, "error", "not an orthogonal matrix"


def no_focal_length(arrays):
    arrays["cameras/front/intrinsics"][1, 1] = 0
    return "cameras/front/intrinsics", None, "error", "focal lengths [20.0, 0.0] px"


def depth_without_unit(arrays):
    del arrays["cameras/front/depth_scale"]
    return "cameras/front/depth_scale", None, "error", "missing, so the depth has no unit"


def workspace_upside_down(arrays):
    arrays["workspace"][2] = arrays["workspace"][2, ::-1].copy()
    return "workspace", 2, "error", "the lower bound is not below the upper bound"


def label_missing(arrays):
    del arrays["labels/direction"]
    return "labels", None, "warning", "label missing: direction"


def label_inconsistent(arrays):
    arrays["labels/direction"] = (arrays["labels/direction"] + 1) % 4
    return "labels/direction", None, "error", "label inconsistent: direction"


def label_impossible(arrays):
    arrays["labels/direction"] = np.array(7)
    return "labels/direction", None, "error", "direction 7 is none of 0 to 3"


SPOILERS = [
    duplicate_time, backward_time, clock_set_back, clock_set_forward, camera_clock_set_forward, gap, jitter, drop_outs,
    foreign_clock, late_start, early_end, empty_stream, saturation, stuck, no_sensor, tare_missing,
    tare_of_another_day, black_image, grey_image, frozen_picture, depth_holes, no_depth, constant_depth,
    action_too_large, opening_too_large, turn_too_large, hand_far_away, gripper_opening_in_metres, quaternion_not_unit,
    camera_pose_not_rigid, camera_pose_mirrored, image_axes_stretched, no_focal_length, depth_without_unit,
    workspace_upside_down, label_missing, label_inconsistent, label_impossible,
]  # fmt: skip


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


def test_the_bounds_of_the_configuration_come_first():
    config = {"world": {"max_move": 0.05, "max_turn": 0.2}}
    arrays = fresh()
    arrays["actions/action"][6, 2] = 0.04
    assert findings(dict(arrays), config) == []
    arrays["actions/action"] = arrays["actions/action"] * np.float32([1, 1.5, 1.5, 1.5, 1])
    (found,) = findings(arrays, config)
    assert "outside -0.05 to 0.05 m (bounds: config)" in found.words


def test_tasks_without_labels_need_none():
    arrays = fresh()
    del arrays["labels/direction"], arrays["labels/offset"]
    assert findings(arrays, task="picking") == []
    (found,) = findings(arrays)
    assert found.words == "label missing: offset and direction"


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
    assert len(CHECKS) == len(set(CHECKS))


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
    from collectors.centering import CenteringCollector
    from collectors.simulation.config import WorldConfig
    from collectors.simulation.noise import NoiseConfig

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
