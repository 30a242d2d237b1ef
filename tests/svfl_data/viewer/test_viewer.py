import io
import itertools
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from PIL import Image
from rerun.chunk import RrdReader

from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.episode import Episode, Meta
from svfl_data.signals.transforms import LowPass, Tare, as_record, processed_wrench
from svfl_data.viewer import recording, show
from svfl_data.viewer.entities import cameras, plots, scene
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_data.viewer.summary_text import summary_text
from svfl_data.viewer.views import axis_range
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.rerun_files import encoded, entities, logged

RERUN = Path(sys.executable).parent / "rerun"


@pytest.fixture(scope="module", autouse=True)
def _strict():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CI", "1")  # no usage statistics
        rr.set_strict_mode(True)  # what rerun would only warn about fails
        yield
        rr.set_strict_mode(False)


def verify(path):
    return subprocess.run([RERUN, "rrd", "verify", path], capture_output=True, text=True, check=False)


def save(episode, path, root=""):
    show.save(show.content([(EpisodeSource.of(episode, root), None)]), path)


def without(episode, *paths):
    return Episode(episode.meta, {path: array for path, array in episode.arrays.items() if path not in paths})


@pytest.fixture(scope="module")
def episode():
    return make_episode(index=3, steps=5, size=20)


@pytest.fixture(scope="module")
def saved(episode, tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "episode.rrd"
    save(episode, path)
    return path


def test_rerun_accepts_the_file_and_notices_a_truncated_one(saved, tmp_path):
    assert verify(saved).returncode == 0, verify(saved).stderr
    broken = tmp_path / "broken.rrd"
    broken.write_bytes(saved.read_bytes()[:-200])
    assert verify(broken).returncode != 0


def test_the_file_brings_its_arrangement_and_one_timeline(saved):
    reader = RrdReader(saved)
    assert len(reader.blueprints()) == 1
    indexed = {
        name
        for chunk in reader.stream().to_chunks()
        for name in chunk.to_record_batch().schema.names
        if name in ("time", "log_time", "log_tick", "frame_nr")
    }
    assert indexed == {"time"}


@pytest.mark.parametrize(("name", "part"), [("force", slice(0, 3)), ("torque", slice(3, 6))])
def test_every_wrench_reading_is_there_exactly(saved, episode, name, part):
    t_ns, values = logged(saved, f"wrench/{name}", "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.wrench_t_ns)
    np.testing.assert_array_equal(values, episode.tared_wrench[:, part])
    assert len(logged(saved, f"wrench/{name}", "SeriesLines:names", timed=False)) == 3


def test_actions_are_there_with_the_time_of_their_observation(saved, episode):
    t_ns, displacement = logged(saved, "motion/commanded", "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.t_ns[:-1])
    np.testing.assert_array_equal(displacement, episode.action[:, 1:4])
    _, turn = logged(saved, "motion/commanded_turn", "Scalars:scalars")
    np.testing.assert_array_equal(turn, episode.action[:, 4:])


def test_what_was_achieved_is_the_next_observation_minus_this_one(saved, episode):
    t_ns, moved = logged(saved, "motion/achieved", "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.t_ns[:-1])
    np.testing.assert_allclose(moved, np.diff(episode.proprio[:, 1:4], axis=0))


def test_reward_is_one_for_the_last_action_of_a_success(saved, episode):
    t_ns, values = logged(saved, "reward", "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.t_ns)
    assert values[:, 0].tolist() == [0.0] * (len(episode) - 1) + [1.0, 0.0]
    assert values[-1, 1] == 1.0


def test_raw_readings_are_there_and_the_window_of_the_cursor_is_64_of_them(saved, episode):
    t_ns, raw = logged(saved, "wrench/raw/force", "Scalars:scalars")
    np.testing.assert_array_equal(raw, episode.wrench[:, :3])
    np.testing.assert_array_equal(logged(saved, "wrench/window/force", "Scalars:scalars")[0], t_ns)
    reach_ns = (WINDOW - 0.5) * 2_000_000  # as the blueprint shows them before the cursor
    now = episode.t_ns[-1]
    assert ((t_ns > now - reach_ns) & (t_ns <= now)).sum() == WINDOW


@pytest.mark.parametrize("at_once", [7, 50, 10_000])
def test_readings_in_pieces_are_those_of_the_whole_stream(episode, at_once):
    filters = [Tare(), LowPass(20.0)]
    filtered = Episode(replace(episode.meta, transforms=[as_record(one) for one in filters]), episode.arrays)
    pieces = list(EpisodeSource.of(filtered).readings(recording.RULE, at_once))
    np.testing.assert_array_equal(np.concatenate([piece.t_ns for piece in pieces]), episode.wrench_t_ns)
    whole = processed_wrench(filtered)
    np.testing.assert_allclose(np.concatenate([piece.wrench for piece in pieces]), whole, atol=1e-5)


def test_contact_is_marked_where_the_block_is_touched(episode, tmp_path):
    wrench = np.array(episode.wrench)
    wrench[-80:, 2] += 20.0
    save(Episode(episode.meta, episode.arrays | {"streams/wrench/wrench": wrench}), tmp_path / "touched.rrd")
    t_ns, level = logged(tmp_path / "touched.rrd", "wrench/marks/contact", "Scalars:scalars")
    assert 0 <= t_ns[0] - episode.wrench_t_ns[-80] < 10e6  # the low-pass is a little late
    assert np.isnan(level[-1, 0])
    assert t_ns[-1] == episode.wrench_t_ns[-1]


def test_recorded_contacts_are_shown_as_recorded(episode, tmp_path):
    mark = {"name": "contact", "start_ns": 210_000_000, "end_ns": 230_000_000}
    save(Episode(replace(episode.meta, annotations=[mark]), episode.arrays), tmp_path / "marked.rrd")
    t_ns, _ = logged(tmp_path / "marked.rrd", "wrench/marks/contact", "Scalars:scalars")
    assert (t_ns[0], t_ns[-1]) == (mark["start_ns"], mark["end_ns"])


@pytest.mark.parametrize("number", [1, plots.MOST_NAMES - 1, plots.MOST_NAMES, 50_000])
def test_however_many_names_annotations_have_all_are_shown_on_few_curves(number):
    annotations = [{"name": f"a{one:05d}", "start_ns": one, "end_ns": one + 1} for one in range(number)]
    marks = plots.marks_by_name([*annotations, {"name": "contact", "start_ns": 0, "end_ns": 9}])
    assert len(marks) <= plots.MOST_NAMES + 1
    assert next(iter(marks)) == "contact"
    assert sorted(itertools.chain(*marks.values())) == sorted([(0, 9), *((one, one + 1) for one in range(number))])


def test_path_is_brightest_where_the_force_is_largest(saved):
    colors = logged(saved, "scene/path", "LineStrips3D:colors", timed=False)
    brightness = [sum((color >> shift) & 255 for shift in (8, 16, 24)) for color in colors]
    assert int(np.argmax(brightness)) == len(colors) - 1  # the collision ends the episode
    assert brightness[0] < brightness[-1]


def test_long_pictures_are_small_and_their_depth_exact(episode, tmp_path, monkeypatch):
    monkeypatch.setattr(cameras, "EXACT_BYTES", 0)
    save(episode, tmp_path / "small.rrd")
    blobs = encoded(tmp_path / "small.rrd", "scene/cameras/front/depth", "EncodedDepthImage:blob")
    for blob, depth in zip(blobs, episode.cameras["front"].depth, strict=True):
        np.testing.assert_array_equal(np.array(Image.open(io.BytesIO(blob))), depth)
    colors = encoded(tmp_path / "small.rrd", "scene/cameras/front/color", "EncodedImage:blob")
    assert [Image.open(io.BytesIO(blob)).format for blob in colors] == ["JPEG"] * len(blobs)


def test_several_episodes_have_folders_of_their_own(episode, tmp_path):
    pair = [(EpisodeSource.of(episode, f"episode_{number}/"), None) for number in (3, 4)]
    show.save(show.content(pair), tmp_path / "pair.rrd")
    found = entities(tmp_path / "pair.rrd")
    for number in (3, 4):
        assert f"/episode_{number}/wrench/force" in found
        assert f"/episode_{number}/scene/cameras/front/color" in found
    assert verify(tmp_path / "pair.rrd").returncode == 0


def test_arm_is_drawn_where_joints_are_recorded_and_the_gripper_alone_where_not(saved, episode, tmp_path):
    pytest.importorskip("pybullet_data")
    arm, gripper = "/scene/robot/panda_link0/panda_link1", "/scene/gripper"
    assert arm in entities(saved)
    with pytest.raises(AssertionError):
        logged(saved, "scene/gripper", "Boxes3D:half_sizes")
    save(without(episode, "streams/joints/t_ns", "streams/joints/position"), tmp_path / "gripper.rrd")
    assert gripper in entities(tmp_path / "gripper.rrd")
    assert arm not in entities(tmp_path / "gripper.rrd")


def test_images_are_lossless_and_depth_is_metric(saved, episode):
    camera = episode.cameras["front"]
    t_ns, color = logged(saved, "scene/cameras/front/color", "Image:buffer")
    np.testing.assert_array_equal(t_ns, camera.t_ns)
    np.testing.assert_array_equal(color.astype(np.uint8).reshape(camera.color.shape), camera.color)
    _, depth = logged(saved, "scene/cameras/front/depth", "DepthImage:buffer")
    units = depth.astype(np.uint8).reshape(len(t_ns), -1).view(np.uint16).reshape(camera.depth.shape)
    metres = units / logged(saved, "scene/cameras/front/depth", "DepthImage:meter", timed=False)[0]
    np.testing.assert_allclose(metres, camera.depth_m, rtol=1e-6)


def test_the_tcp_is_where_proprio_says(saved, episode):
    _, position = logged(saved, "scene/tcp", "Transform3D:translation")
    np.testing.assert_array_equal(position[:, 0], episode.proprio[:, 1:4])
    _, quat_xyzw = logged(saved, "scene/tcp", "Transform3D:quaternion")
    yaw = 2 * np.arctan2(quat_xyzw[:, 0, 2], quat_xyzw[:, 0, 3])
    np.testing.assert_allclose(np.exp(1j * yaw), np.exp(1j * episode.proprio[:, 4]), atol=1e-6)


def test_fingers_open_along_y_from_touching_to_eight_centimetres():
    half_sizes, centres = scene.gripper_boxes(np.array([0.0, 1.0]))
    left, right = (centres - half_sizes)[:, 1, 1], (centres + half_sizes)[:, 2, 1]
    np.testing.assert_allclose(left - right, [0.0, 0.08])


def test_force_arrow_has_the_stated_scale_and_starts_at_the_wrist(saved, episode):
    t_ns, vectors = logged(saved, "scene/wrist/force", "Arrows3D:vectors")
    expected = episode.tared_wrench[-len(t_ns) :, :3] * scene.METRES_PER_NEWTON
    np.testing.assert_allclose(vectors[:, 0], expected, rtol=1e-6)
    np.testing.assert_array_equal(t_ns, episode.wrench_t_ns[-len(t_ns) :])
    assert f"{scene.METRES_PER_NEWTON * 1e3:.0f} mm per N;" in summary_text(EpisodeSource.of(episode), 1.0)
    _, wrist = logged(saved, "scene/wrist", "Transform3D:translation")
    np.testing.assert_allclose(wrist[:, 0] - episode.proprio[:, 1:4], [[0, 0, 0.105]] * len(wrist), atol=1e-6)


def test_label_arrow_is_the_offset_and_appears_with_the_last_observation(saved, episode):
    t_ns, vectors = logged(saved, "scene/label_offset", "Arrows3D:vectors")
    assert t_ns.tolist() == [episode.t_ns[-1]]
    np.testing.assert_allclose(vectors[0, 0], [*episode.label_offset, 0.0], rtol=1e-6)
    _, target = logged(saved, "scene/label_target", "Transform3D:translation")
    np.testing.assert_allclose(target[0, 0, :2], episode.object_pose[-1, :2], atol=1e-6)  # over the block


@pytest.mark.parametrize(
    ("entity", "component", "first"),
    [
        ("scene/tcp", "Transform3D:translation", 0),
        ("scene/object", "Boxes3D:half_sizes", 0),
        ("scene/wrist/force", "Arrows3D:vectors", 0),
        ("scene/wrist/torque", "Arrows3D:vectors", 0),
        ("scene/label_target", "Boxes3D:half_sizes", -1),
    ],
)
def test_nothing_is_drawn_before_it_is_known_where(saved, episode, entity, component, first):
    t_ns, _ = logged(saved, entity, component)
    assert episode.wrench_t_ns[0] < episode.t_ns[0]
    assert t_ns[0] == episode.t_ns[first]


def test_block_has_the_recorded_size_or_says_that_it_is_not_known(episode, tmp_path):
    known = Episode(episode.meta, episode.arrays | {"streams/object/half_extents": np.array([0.01, 0.02, 0.03])})
    unknown = Episode(
        episode.meta, {name: a for name, a in episode.arrays.items() if name != "streams/object/half_extents"}
    )
    save(known, tmp_path / "known.rrd")
    _, sizes = logged(tmp_path / "known.rrd", "scene/object", "Boxes3D:half_sizes")
    np.testing.assert_allclose(sizes, [[[0.01, 0.02, 0.03]]] * len(episode.t_ns))
    assert "size not recorded" in summary_text(EpisodeSource.of(unknown), 1.0)
    assert "size not recorded" not in summary_text(EpisodeSource.of(known), 1.0)


def test_text_says_what_it_is_and_what_the_numbers_mean(episode):
    text = summary_text(EpisodeSource.of(episode), 1.0)
    for words in ("centering, episode 3: success", "seed 0", "500 Hz", "base axes", "sensor origin", "-8.00) N"):
        assert words in text
    dx, dy = episode.label_offset * 1e3
    assert f"({dx:+.1f}, {dy:+.1f}) mm" in text


def test_an_episode_with_nothing_optional_and_nothing_measured_is_shown_too(tmp_path):
    arrays = episode_arrays(np.random.default_rng(0), steps=1)
    needed = {"observations/t_ns", "observations/proprio", "actions/action", "workspace"}
    needed |= {f"streams/wrench/{leaf}" for leaf in ("t_ns", "wrench", "tare")}
    arrays = {path: array for path, array in arrays.items() if path in needed or path.startswith("cameras/")}
    arrays["cameras/front/depth"] = np.zeros_like(arrays["cameras/front/depth"])
    for path in ("streams/wrench/wrench", "streams/wrench/t_ns"):
        arrays[path] = arrays[path][:0]
    save(Episode(Meta("picking", 0, 0, "robot", False), arrays), tmp_path / "bare.rrd")
    assert verify(tmp_path / "bare.rrd").returncode == 0


@pytest.mark.parametrize("top", [3e-4, 0.02, 0.8, 1.0, 2.2, 7.9, 20.0, 80.0, 450.0])
def test_axis_shows_every_value_and_writes_a_number_beside_zero(top):
    values = np.array([-top, top])
    low, high = axis_range(float(values.min()), float(values.max()))
    assert low < -top
    assert high > top
    written = 10.0 ** np.ceil(np.log10((high - low) / 9))
    assert high > written or low < -written


def test_axis_of_a_constant_has_a_range():
    for value in (0.0, 1.0):
        low, high = axis_range(value, value)
        assert low < high
