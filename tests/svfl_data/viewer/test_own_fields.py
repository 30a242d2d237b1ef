"""Whatever an episode declares is drawn from its declaration, and whatever it lacks is left out."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field import Field
from svfl_data.schema.optics import rotations
from svfl_data.signals.camera_poses import camera_poses
from svfl_data.viewer import show
from svfl_data.viewer.entities import fields, images, scene
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_data.viewer.summary_text import summary_text
from tests.helpers.builders import make_episode
from tests.helpers.open_episode import OWN, bare_episode, clock, open_arrays, open_episode
from tests.helpers.rerun_files import entities, logged


@pytest.fixture(scope="module", autouse=True)
def _strict():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CI", "1")
        rr.set_strict_mode(True)
        yield
        rr.set_strict_mode(False)


def save(episode, path):
    show.save(show.content([(EpisodeSource.of(episode), None)]), path)
    done = subprocess.run(
        [Path(sys.executable).parent / "rerun", "rrd", "verify", path], capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return path


def changed(own=OWN, **changes):
    arrays = open_arrays() | {path.replace("__", "/"): array for path, array in changes.items()}
    present = {path: array for path, array in arrays.items() if array is not None}
    return Episode(Meta("cups", 0, 0, "teleop", True), present, declarations=own)


@pytest.fixture(scope="module")
def episode():
    return open_episode()


@pytest.fixture(scope="module")
def saved(episode, tmp_path_factory):
    return save(episode, tmp_path_factory.mktemp("own") / "open.rrd")


def test_a_field_nobody_knows_has_a_curve_per_component_with_name_and_unit(saved, episode):
    entity = "fields/observations/tcp_velocity"
    t_ns, values = logged(saved, entity, "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.t_ns)
    np.testing.assert_array_equal(values, episode["observations/tcp_velocity"])
    assert logged(saved, entity, "SeriesLines:names", timed=False) == ["vx, m/s", "vy, m/s", "vz, m/s"]
    _, position = logged(saved, "fields/streams/joints/position", "Scalars:scalars")
    np.testing.assert_array_equal(position, episode.joints)
    names = logged(saved, "fields/streams/joints/position", "SeriesLines:names", timed=False)
    assert names == [str(number) for number in range(6)]


def test_a_command_of_seven_components_is_drawn_by_unit_at_the_time_of_its_observation(saved, episode):
    t_ns, turns = logged(saved, "fields/actions/action/unit_1", "Scalars:scalars")
    np.testing.assert_array_equal(t_ns, episode.t_ns[:-1])
    np.testing.assert_array_equal(turns, episode.action[:, 3:6])
    names = logged(saved, "fields/actions/action/unit_0", "SeriesLines:names", timed=False)
    assert names == ["dx, m", "dy, m", "dz, m"]
    assert not any(entity.startswith("/motion") for entity in entities(saved))


def test_tactile_pictures_are_exact_and_on_their_own_clock(saved, episode):
    rows = {}
    for chunk in RrdReader(saved).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == "/fields/streams/tactile/pressure" and not chunk.is_static:
            times = batch.column("time").cast("int64").to_pylist()
            rows |= dict(zip(times, batch.column("Tensor:data").to_pylist(), strict=True))
    assert sorted(rows) == episode["streams/tactile/t_ns"].tolist()
    (last,) = rows[max(rows)]
    assert last["shape"] == [16, 33]
    picture = np.array(last["buffer"], np.float32).reshape(16, 33)
    np.testing.assert_array_equal(picture[:, :16], episode["streams/tactile/pressure"][-1, 0])
    np.testing.assert_array_equal(picture[:, 17:], episode["streams/tactile/pressure"][-1, 1])


def test_texts_are_a_log(saved):
    t_ns, words = logged(saved, "fields/streams/notes/words", "TextLog:text")
    assert words[:, 0].tolist() == ["reaching", "contact"]
    assert t_ns.tolist() == [200_000_000, 700_000_000]


def test_a_second_wrench_is_tared_if_it_has_a_tare_and_an_arrow_only_in_base_axes(saved, episode, tmp_path):
    raw = episode["streams/left_finger/wrench"]
    _, force = logged(saved, "fields/streams/left_finger/wrench/force", "Scalars:scalars")
    np.testing.assert_array_equal(force, raw[:, :3])
    assert not any("/wrist/streams" in entity for entity in entities(saved))
    own = Declarations(
        [*(one for one in OWN.own if "left_finger" not in one.path), *wrench_stream("left_finger", "base")]
    )
    tare = np.arange(6.0)
    file = save(changed(own, streams__left_finger__tare=tare), tmp_path / "tared.rrd")
    _, force = logged(file, "fields/streams/left_finger/wrench/force", "Scalars:scalars")
    np.testing.assert_allclose(force, raw[:, :3] - tare[:3])
    _, force = logged(file, "fields/streams/left_finger/wrench/raw_force", "Scalars:scalars")
    np.testing.assert_array_equal(force, raw[:, :3])
    (arrow,) = (entity for entity in entities(file) if "/wrist/streams" in entity and entity.endswith("force"))
    t_ns, vectors = logged(file, arrow.lstrip("/"), "Arrows3D:vectors")
    np.testing.assert_array_equal(t_ns, episode["streams/left_finger/t_ns"])
    np.testing.assert_allclose(vectors[:, 0], (raw - tare)[:, :3] * scene.METRES_PER_NEWTON, rtol=1e-5, atol=1e-7)


def test_a_camera_on_the_gripper_is_where_the_tcp_was_at_or_before_each_frame(saved, episode):
    t_ns, position = logged(saved, "scene/cameras/wrist", "Transform3D:translation")
    camera = episode.cameras["wrist"]
    np.testing.assert_array_equal(t_ns, camera.t_ns)
    rows = np.searchsorted(episode.tcp_t_ns, camera.t_ns, side="right") - 1
    yaw = 2 * np.arctan2(episode.tcp_pose[rows, 5], episode.tcp_pose[rows, 6])
    along = np.stack([0.05 * np.cos(yaw), 0.05 * np.sin(yaw), np.full(len(rows), 0.05)], axis=1)
    np.testing.assert_allclose(position[:, 0], episode.tcp_pose[rows, :3] + along, atol=1e-6)
    _, quat_xyzw = logged(saved, "scene/cameras/wrist", "Transform3D:quaternion")
    assert np.isfinite(quat_xyzw).all()
    assert "**Camera wrist** is on the gripper." in summary_text(EpisodeSource.of(episode), 1.0)


def test_a_mounted_camera_is_not_drawn_before_the_first_pose_of_the_tcp(tmp_path):
    arrays = open_arrays()
    episode = changed(
        streams__tcp__t_ns=arrays["streams/tcp/t_ns"][75:], streams__tcp__pose=arrays["streams/tcp/pose"][75:]
    )
    file = save(episode, tmp_path / "late.rrd")
    _, quat_xyzw = logged(file, "scene/cameras/wrist", "Transform3D:quaternion")
    assert np.isnan(quat_xyzw[:2]).all()
    assert np.isfinite(quat_xyzw[2:]).all()


def test_a_camera_that_moves_by_itself_has_its_recorded_poses(tmp_path):
    moving = np.tile(open_arrays()["cameras/front/T_base_camera"], (11, 1, 1))
    moving[:, 2, 3] = np.linspace(0.3, 0.5, 11)
    changes = {"cameras__front__T_base_camera": None, "cameras__front__T_base_camera_per_frame": moving}
    episode = changed(**changes)
    file = save(episode, tmp_path / "moving.rrd")
    _, position = logged(file, "scene/cameras/front", "Transform3D:translation")
    np.testing.assert_allclose(position[:, 0], moving[:, :3, 3], rtol=1e-6)
    assert "/scene/cameras/front/depth" in entities(file)  # the point cloud is below the camera, and follows it
    np.testing.assert_array_equal(camera_poses(episode.arrays, "front", episode.cameras["front"].t_ns), moving)


def test_rotations_and_quaternions_agree():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(50, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    found = images.quaternions(rotations(q))
    np.testing.assert_allclose(np.abs((found * q).sum(axis=1)), 1.0, atol=1e-9)


@pytest.mark.parametrize("lack", ["T_base_camera", "intrinsics"])
def test_a_camera_without_a_place_is_a_picture_only_and_the_text_says_so(tmp_path, lack):
    episode = changed(**{f"cameras__front__{lack}": None})
    file = save(episode, tmp_path / "nowhere.rrd")
    assert "/pictures/front/color" in entities(file)
    assert not any(entity.startswith("/scene/cameras/front") for entity in entities(file))
    words = {"T_base_camera": "its pose was", "intrinsics": "its intrinsics were"}[lack]
    assert f"**Camera front** is shown as a picture only: {words} not recorded." in summary_text(
        EpisodeSource.of(episode), 1.0
    )


def test_grey_pictures_and_pictures_of_ones_own_are_exact(tmp_path):
    rng = np.random.default_rng(0)
    thermal = Field(path="cameras/wrist/thermal", dtype="float32", shape=("F", "H", "W"), unit="K", image=True)
    masks = Field(path="streams/masks/mask", dtype="bool", shape=("T", 8, 8), image=True)
    grey, warm = (
        rng.integers(0, 65535, (11, 32, 32), dtype=np.uint16),
        rng.normal(300, 1, (11, 32, 32)).astype(np.float32),
    )
    changes = {
        "cameras__wrist__color": None, "cameras__wrist__grey16": grey, "cameras__wrist__thermal": warm,
        "streams__masks__mask": rng.random((11, 8, 8)) > 0.5, "streams__masks__t_ns": clock(10, 1),
    }  # fmt: skip
    file = save(changed(OWN.with_own([thermal, masks]), **changes), tmp_path / "grey.rrd")
    for kind, pixels in (("grey16", grey), ("thermal", warm)):
        _, buffer = logged(file, f"scene/cameras/wrist/{kind}", "Image:buffer")
        found = buffer.astype(np.uint8).reshape(11, -1).view(pixels.dtype).reshape(pixels.shape)
        np.testing.assert_array_equal(found, pixels)
    assert "/fields/streams/masks/mask" in entities(file)


def test_the_text_says_who_did_what_and_what_is_assumed(episode):
    text = summary_text(EpisodeSource.of(episode), 1.0)
    assert "**Instruction:** put the cup on the plate; **Robot:** ur5e; **Operator:** A." in text
    assert "observations/tcp_velocity: axes are assumed, parts are assumed." in text


@pytest.mark.parametrize(
    "lost",
    [
        ("streams/wrench/tare",), ("streams/wrench/",), ("streams/tcp/",), ("cameras/",), ("streams/",),
        ("streams/", "cameras/", "observations/tcp_velocity"),
    ],
)  # fmt: skip
def test_whatever_is_missing_is_left_out(lost, tmp_path):
    arrays = {path: array for path, array in open_arrays().items() if not path.startswith(lost)}
    save(Episode(Meta("cups", 0, 0, "teleop", True), arrays, declarations=OWN), tmp_path / "less.rrd")


@pytest.mark.parametrize("lost", ["workspace", "observations/proprio", "streams/wrench", "streams/wrench/tare"])
def test_the_planar_episode_is_shown_without_each_of_its_parts(lost, tmp_path):
    episode = make_episode()
    arrays = {path: array for path, array in episode.arrays.items() if not path.startswith(lost)}
    save(Episode(episode.meta, arrays), tmp_path / "less.rrd")


def test_joint_commands_alone_are_shown_and_several_such_episodes_side_by_side(tmp_path):
    file = save(bare_episode(), tmp_path / "bare.rrd")
    names = logged(file, "fields/actions/action", "SeriesLines:names", timed=False)
    assert names[:2] == ["pan, rad", "lift, rad"]
    assert not any(entity.startswith(("/wrench/force", "/proprio")) for entity in entities(file))
    pair = [(EpisodeSource.of(one, f"episode_{k}/"), None) for k, one in enumerate((bare_episode(), open_episode()))]
    show.save(show.content(pair), tmp_path / "pair.rrd")
    assert "/episode_1/fields/streams/tactile/pressure" in entities(tmp_path / "pair.rrd")


def test_however_many_fields_there_are_the_window_has_a_limited_number_of_plots(episode):
    many = [Field(path=f"observations/a{number:04d}", dtype="float32", shape=("N+1",)) for number in range(300)]
    arrays = open_arrays() | {one.path: np.zeros(21, np.float32) for one in many}
    big = Episode(Meta("cups", 0, 0, "teleop", True), arrays, declarations=OWN.with_own(many))
    views = fields.field_views(EpisodeSource.of(big))
    assert len(views) == fields.MOST_VIEWS
    assert "211 further fields are not drawn" in summary_text(EpisodeSource.of(big), 1.0)


def test_rows_of_many_numbers_are_one_picture_and_single_numbers_one_curve(tmp_path):
    own = OWN.with_own([
        Field(path="observations/embedding", dtype="float32", shape=("N+1", 64)),
        Field(path="observations/valve", dtype="bool", shape=("N+1",)),
        Field(path="labels/mass", dtype="float64", shape=(), unit="kg"),
        Field(path="labels/cup", dtype="S8", shape=()),
    ])  # fmt: skip
    more = {"observations__embedding": np.ones((21, 64), np.float32), "observations__valve": np.arange(21) > 3}
    labels = {"labels__mass": np.array(0.25), "labels__cup": np.array(b"red", "S8")}
    episode = changed(own, **more, **labels)
    file = save(episode, tmp_path / "rows.rrd")
    assert logged(file, "fields/observations/embedding", "Tensor:data", timed=False)[0]["shape"] == [64, 21]
    _, valve = logged(file, "fields/observations/valve", "Scalars:scalars")
    assert valve[:, 0].tolist() == [0.0] * 4 + [1.0] * 17
    text = summary_text(EpisodeSource.of(episode), 1.0)
    assert "**labels/mass, kg:** 0.25" in text
    assert "**labels/cup:** red" in text


def test_the_arm_of_the_simulation_is_not_drawn_for_another_robot(tmp_path):
    episode = make_episode()
    other = replace(episode, meta=replace(episode.meta, robot="ur10"))
    assert not any("/scene/robot" in entity for entity in entities(save(other, tmp_path / "other.rrd")))
