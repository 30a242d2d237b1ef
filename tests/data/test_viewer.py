import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from svfl_data import recording, scene, viewer
from svfl_data.blueprint import axis_range
from svfl_data.episode import Episode, Meta
from svfl_data.fields import OF_EPISODE
from tests.builders import episode_arrays, make_episode

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


def logged(path, entity, component, timed=True):
    """Rows of one component and their times, as written in the file."""
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == f"/{entity}" and component in batch.schema.names and chunk.is_static != timed:
            rows = batch.column(component).to_pylist()
            return (batch.column("time").cast("int64").to_numpy(), np.array(rows)) if timed else rows[0]
    raise AssertionError(f"{entity} has no {component}")


@pytest.fixture(scope="module")
def episode():
    return make_episode(index=3, steps=5, size=20)


@pytest.fixture(scope="module")
def saved(episode, tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "episode.rrd"
    viewer.save(episode, path)
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
    t_ns, displacement = logged(saved, "action/displacement", "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.t_ns[:-1])
    np.testing.assert_array_equal(displacement, episode.action[:, 1:4])
    np.testing.assert_array_equal(
        logged(saved, "action/opening_and_turn", "Scalars:scalars")[1], episode.action[:, [0, 4]]
    )


def test_images_are_lossless_and_depth_is_metric(saved, episode):
    camera = episode.cameras["front"]
    t_ns, color = logged(saved, "scene/cameras/front/color", "Image:buffer")
    np.testing.assert_array_equal(t_ns, camera.t_ns)
    np.testing.assert_array_equal(color.astype(np.uint8).reshape(camera.color.shape), camera.color)
    _, depth = logged(saved, "scene/cameras/front/depth", "DepthImage:buffer")
    units = depth.astype(np.uint8).reshape(len(t_ns), -1).view(np.uint16).reshape(camera.depth.shape)
    metres = units / logged(saved, "scene/cameras/front/depth", "DepthImage:meter", timed=False)[0]
    np.testing.assert_allclose(metres, camera.depth_m, rtol=1e-6)


def test_the_hand_is_where_proprio_says(saved, episode):
    _, position = logged(saved, "scene/hand", "Transform3D:translation")
    np.testing.assert_array_equal(position[:, 0], episode.proprio[:, 1:4])
    _, quat_xyzw = logged(saved, "scene/hand", "Transform3D:quaternion")
    yaw = 2 * np.arctan2(quat_xyzw[:, 0, 2], quat_xyzw[:, 0, 3])
    np.testing.assert_allclose(np.exp(1j * yaw), np.exp(1j * episode.proprio[:, 4]), atol=1e-6)


def test_fingers_open_along_y_from_touching_to_eight_centimetres():
    half_sizes, centres = scene.hand_boxes(np.array([0.0, 1.0]))
    left, right = (centres - half_sizes)[:, 1, 1], (centres + half_sizes)[:, 2, 1]
    np.testing.assert_allclose(left - right, [0.0, 0.08])


def test_force_arrow_has_the_stated_scale_and_starts_at_the_wrist(saved, episode):
    t_ns, vectors = logged(saved, "scene/wrist/force", "Arrows3D:vectors")
    expected = episode.tared_wrench[-len(t_ns) :, :3] * scene.METRES_PER_NEWTON
    np.testing.assert_allclose(vectors[:, 0], expected, rtol=1e-6)
    np.testing.assert_array_equal(t_ns, episode.wrench_t_ns[-len(t_ns) :])
    assert f"{scene.METRES_PER_NEWTON * 1e3:.0f} mm per N;" in recording.about(episode)
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
        ("scene/hand", "Boxes3D:half_sizes", 0),
        ("scene/block", "Boxes3D:half_sizes", 0),
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
    viewer.save(known, tmp_path / "known.rrd")
    _, sizes = logged(tmp_path / "known.rrd", "scene/block", "Boxes3D:half_sizes")
    np.testing.assert_allclose(sizes, [[[0.01, 0.02, 0.03]]] * len(episode.t_ns))
    assert "size not recorded" in recording.about(unknown)
    assert "size not recorded" not in recording.about(known)


def test_text_says_what_it_is_and_what_the_numbers_mean(episode):
    text = recording.about(episode)
    for words in ("centering, episode 3: success", "seed 0", "500 Hz", "base axes", "sensor origin", "-8.00) N"):
        assert words in text
    dx, dy = episode.label_offset * 1e3
    assert f"({dx:+.1f}, {dy:+.1f}) mm" in text


def test_an_episode_with_nothing_optional_and_nothing_measured_is_shown_too(tmp_path):
    arrays = episode_arrays(np.random.default_rng(0), steps=1)
    needed = {field.path for field in OF_EPISODE.values() if not field.optional}
    arrays = {path: array for path, array in arrays.items() if path in needed or path.startswith("cameras/")}
    arrays["cameras/front/depth"] = np.zeros_like(arrays["cameras/front/depth"])
    for path in ("streams/wrench/wrench", "streams/wrench/t_ns"):
        arrays[path] = arrays[path][:0]
    viewer.save(Episode(Meta("picking", 0, 0, "robot", False), arrays), tmp_path / "bare.rrd")
    assert verify(tmp_path / "bare.rrd").returncode == 0


@pytest.mark.parametrize("top", [3e-4, 0.02, 0.8, 1.0, 2.2, 7.9, 20.0, 80.0, 450.0])
def test_axis_shows_every_value_and_writes_a_number_beside_zero(top):
    values = np.array([-top, top])
    low, high = axis_range(values)
    assert low < -top
    assert high > top
    written = 10.0 ** np.ceil(np.log10((high - low) / 9))
    assert high > written or low < -written


def test_axis_of_constant_and_missing_values_has_a_range():
    for values in (np.zeros(3), np.full(3, 1.0), np.zeros((0, 3))):
        low, high = axis_range(values)
        assert low < high
