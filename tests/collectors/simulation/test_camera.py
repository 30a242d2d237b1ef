import dataclasses

import numpy as np
import pybullet
import pytest

from collectors.recording.loop import record
from collectors.robots import make
from collectors.simulation import CameraConfig, World, WorldConfig
from collectors.simulation.camera import CAMERAS
from collectors.sources.expert import ExpertCollector
from svfl_data.checks import check_episode
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.store import read_episode, write_episode
from tests.helpers.worlds import hold, move

SEEN_FROM_THE_SIDE = CameraConfig(height=60, width=80, eye=(0.6, 0.9, 0.5), target=(0.5, 0.0, 0.05), up=(0.0, 0.0, 1.0))


def points_in_base(world: World, depth: np.ndarray) -> np.ndarray:
    """Every pixel as a point in base, (H, W, 3): the pinhole model with the stored calibration."""
    camera = world.camera
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(camera.intrinsics).T
    in_camera = rays * (depth * camera.depth_scale)[:, :, None]
    return in_camera @ camera.T_base_camera[:3, :3].T + camera.T_base_camera[:3, 3]


def pixel(world: World, point: tuple[float, float, float]) -> np.ndarray:
    """Column and row where a point in base is seen."""
    camera = world.camera
    in_camera = np.linalg.inv(camera.T_base_camera) @ [*point, 1.0]
    u, v, w = camera.intrinsics @ in_camera[:3]
    return np.array([u, v]) / w


TILTED = CameraConfig(up=(0.0, 1.0, 0.0))  # here an error of half a column shows in the height of the table


@pytest.mark.parametrize("camera", [CameraConfig(), SEEN_FROM_THE_SIDE, TILTED])
def test_depth_and_calibration_put_the_table_and_a_box_where_they_are(ideal: WorldConfig, camera: CameraConfig):
    with World(dataclasses.replace(ideal, cameras={"front": camera})) as world:
        world.reset(seed=0)
        bare = world.observe().frames["front"]
        world.add_box((0.04, 0.04, 0.03), (0.65, 0.1, 0.03), 0.0, 0.0, 0.5, color=(0.0, 0.0, 1.0))
        boxed = world.observe().frames["front"]
    table = np.ptp(bare.color.astype(int) - bare.color[-1, -1], axis=-1) == 0  # the table's one colour
    table &= (bare.color == bare.color[-1, -1]).all(axis=-1)
    points = points_in_base(world, bare.depth)
    assert table.mean() > 0.3
    assert np.abs(points[table][:, 2]).max() < 2e-4
    changed = bare.depth != boxed.depth
    top = points_in_base(world, boxed.depth)[changed]
    assert np.abs(top[:, 2].max() - 0.06) < 1e-3
    assert np.abs(top[:, :2] - [0.65, 0.1]).max() < 0.04 + 2e-3


def test_image_axes_turn_base_vectors_into_right_and_up(world: World):
    np.testing.assert_allclose(world.camera.image_axes, [[0, 1], [-1, 0]], atol=1e-12)
    centre = np.array([0.55, 0.0])
    for step in ([0.05, 0.0], [0.0, 0.05], [-0.03, 0.04]):
        seen = pixel(world, (*(centre + step), 0.0)) - pixel(world, (*centre, 0.0))
        right, up = world.camera.image_axes @ step
        assert np.sign(np.round(seen[0], 6)) == np.sign(np.round(right, 6))
        assert np.sign(np.round(-seen[1], 6)) == np.sign(np.round(up, 6))


def test_the_workspace_centre_is_the_image_centre(world: World):
    centre = world.workspace[:2].mean(axis=1)
    np.testing.assert_allclose(pixel(world, (*centre, 0.0)), [11.5, 11.5], atol=1e-9)


def test_arrays_are_as_promised(ideal: WorldConfig):
    with World(dataclasses.replace(ideal, cameras={"front": CameraConfig(height=20, width=30)})) as world:
        world.reset(seed=0)
        seen = world.observe().frames["front"]
    assert (seen.color.shape, seen.color.dtype) == ((20, 30, 3), np.uint8)
    assert (seen.depth.shape, seen.depth.dtype) == ((20, 30), np.uint16)


def test_what_is_too_far_has_no_depth(ideal: WorldConfig):
    with World(
        dataclasses.replace(ideal, cameras={"front": CameraConfig(height=24, width=24, target=(3.0, 0.0, 2.0))})
    ) as world:
        world.reset(seed=0)
        assert (world.observe().frames["front"].depth == 0).all()


def test_the_floor_has_no_texture_to_navigate_by(ideal: WorldConfig):
    """Below the gripper the picture is one colour: a checkerboard edge would break the planar symmetry."""
    with World(dataclasses.replace(ideal, cameras={"front": CameraConfig()})) as world:
        world.reset(seed=0)
        color = world.observe().frames["front"].color
    assert (color[40:] == color[40, 0]).all()


WRIST = {"front": CAMERAS["front"], "wrist": CAMERAS["wrist"]}


def seen_in_base(calibration, depth):
    """Every pixel as a point in base, (H, W, 3), through the pose of the camera at that moment."""
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(calibration.intrinsics).T
    points = rays * (depth * calibration.depth_scale)[:, :, None]
    return points @ calibration.T_base_camera[:3, :3].T + calibration.T_base_camera[:3, 3]


@pytest.mark.parametrize("robot", ["panda_sim", "ur5e_sim"])
def test_a_camera_on_the_gripper_sees_the_world_where_it_is(robot):
    """Wherever the gripper goes and however it is turned, the table's top is at z = 0 and the block where it lies."""
    config = dataclasses.replace(WorldConfig(cameras=WRIST), robot=make(robot))
    with World(config) as world:
        world.reset(seed=0)
        block = world.add_box((0.025, 0.025, 0.025), (0.55, 0.03, 0.025), 0.3, 0.1, 0.5)
        for goal in ((0.5, 0.0, 0.2, 0.0), (0.55, 0.06, 0.15, 1.0), (0.6, -0.05, 0.22, -1.3)):
            move(world, goal)
            hold(world, 8)
            seen = world.observe()
            frame, calibration = seen.frames["wrist"], world.cameras["wrist"]
            points = seen_in_base(calibration, frame.depth)
            table = (np.abs(frame.color.astype(int) - frame.color[-1, -1]).max(axis=-1) < 8) & (frame.depth > 0)
            assert table.sum() > 500
            assert np.abs(points[table][:, 2]).max() < 2e-3
            blue = frame.color[..., 2].astype(int) - frame.color[..., 0] > 60
            top = points[blue & (points[..., 2] > 0.045)]
            if len(top) > 30:
                assert np.abs(top[:, :2].mean(axis=0) - world.pose(block)[:2]).max() < 0.02


def test_before_the_first_reset_the_gripper_is_taken_to_be_at_home():
    with World(WorldConfig(cameras=WRIST)) as world:
        expected = world.cameras["wrist"].T_base_camera
        world.reset(seed=0)
        np.testing.assert_allclose(world.cameras["wrist"].T_base_camera, expected, atol=5e-3)


def test_an_episode_has_the_mount_and_the_poses_that_give_the_cameras_pose(tmp_path):
    with World(WorldConfig(cameras=WRIST)) as world:
        world.reset(seed=0)
        world.tare()
        calibrations = []
        actions = iter([[1.0, 0.02, -0.01, -0.02, 0.15]] * 4)

        def policy(_):
            calibrations.append(world.cameras["wrist"])
            return next(actions, None)

        arrays = record(world, policy, 10)
    episode = Episode(Meta("moving", 0, 0, "expert", True), arrays)
    write_episode(episode, tmp_path / "e.hdf5")
    read = read_episode(tmp_path / "e.hdf5")
    mount = read.cameras["wrist"].T_tcp_camera
    assert not read.cameras["wrist"].has("T_base_camera")
    assert read.cameras["front"].has("T_base_camera")
    for pose, calibration in zip(read["streams/tcp/pose"], calibrations, strict=True):
        T_base_tcp = np.eye(4)
        T_base_tcp[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(pose[3:]), (3, 3))
        T_base_tcp[:3, 3] = pose[:3]
        np.testing.assert_allclose(T_base_tcp @ mount, calibration.T_base_camera, atol=1e-9)
    assert [one for one in check_episode(read) if one.severity == "error"] == []


def test_a_camera_on_the_gripper_changes_nothing_else():
    def episode(cameras):
        collector = ExpertCollector(seed=0, task="block_pushing", world=WorldConfig(cameras=cameras))
        found = collector(0)
        collector.opened.close()
        return found

    one, other = episode({"front": CAMERAS["front"]}), episode(WRIST)
    assert set(other.arrays) - set(one.arrays) == {
        *(f"cameras/wrist/{leaf}" for leaf in ("t_ns", "color", "depth", "depth_scale", "intrinsics", "T_tcp_camera")),
        "streams/tcp/t_ns", "streams/tcp/pose",
    }  # fmt: skip
    for path, array in one.arrays.items():
        np.testing.assert_array_equal(array, other.arrays[path], err_msg=path)
