"""Poses of cameras that move, and the axes of their images: laws, and equality with independent ways."""

import numpy as np
import pytest

from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.samples import Samples
from svfl_data.schema.optics import rotations
from svfl_data.schema.robot import image_axes
from svfl_data.signals.camera_poses import camera_poses, frame_axes, moves
from svfl_data.symmetry import element
from tests.helpers.own_robot import MOUNT, moving_episode, own_dataset


def random_poses(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    q = rng.normal(size=(count, 4))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = rotations(q / np.linalg.norm(q, axis=1, keepdims=True))
    return poses


def test_axes_of_many_poses_are_those_of_each():
    poses = random_poses(200)
    np.testing.assert_allclose(frame_axes(poses), [image_axes(pose) for pose in poses], atol=1e-12)


@pytest.mark.parametrize("degrees", [30, 90, 180, 271])
def test_axes_turn_with_the_world(degrees):
    """A vector that turns with the world keeps its components in the axes of a camera that turns with it."""
    world, poses = np.eye(4), random_poses(50)
    world[:2, :2] = element(degrees, False)
    np.testing.assert_allclose(frame_axes(world @ poses), frame_axes(poses) @ world[:2, :2].T, atol=1e-12)


def test_where_no_axes_exist_they_are_the_identity():
    poses = random_poses(3)
    poses[0] = np.nan
    poses[1, :3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]  # the image's right is straight up
    axes = frame_axes(poses)
    np.testing.assert_array_equal(axes[:2], [np.eye(2)] * 2)
    np.testing.assert_allclose(axes[2], image_axes(poses[2]), atol=1e-12)


def test_a_mounted_camera_is_where_the_latest_pose_of_the_tcp_puts_it():
    episode = moving_episode(0)
    times = episode["cameras/wrist/t_ns"]
    poses = camera_poses(episode.arrays, "wrist", times)
    for t_ns, pose in zip(times, poses, strict=True):
        row = max(number for number, at in enumerate(episode["streams/tcp/t_ns"]) if at <= t_ns)
        x, y, z, w = episode["streams/tcp/pose"][row, 3:]
        T = np.eye(4)
        T[:3, :3] = [[x * x - y * y, 2 * x * y, 0], [2 * x * y, y * y - x * x, 0], [0, 0, -x * x - y * y]]
        T[:3, 3] = episode["streams/tcp/pose"][row, :3]
        assert z == w == 0
        np.testing.assert_allclose(pose, T @ MOUNT, atol=1e-12)
    before = camera_poses(episode.arrays, "wrist", np.array([0]))
    assert np.isnan(before).all()


def test_what_moves():
    paths = list(moving_episode(0).arrays)
    assert moves(paths, "wrist")
    assert not moves(paths, "front")
    assert not moves([path for path in paths if path != "streams/tcp/pose"], "wrist")
    assert moves(["cameras/front/T_base_camera_per_frame"], "front")


def test_samples_and_the_cut_give_the_axes_of_the_frame(tmp_path):
    dataset = own_dataset(tmp_path / "d", 2, moving_episode)
    samples = Samples(dataset, windows={}, frames=2)
    episode = dataset.read(1)
    poses = camera_poses(episode.arrays, "wrist", episode["cameras/wrist/t_ns"])
    for number in range(len(samples)):
        sample = samples[number]
        assert sample["cameras/wrist/image_axes"].dtype == np.float32
        assert "cameras/front/image_axes" not in sample
        if sample["episode"] == 1:
            step = int(sample["step"])
            expected = [image_axes(poses[max(row, 0)]) for row in (step - 1, step)]  # the first frame is repeated
            np.testing.assert_allclose(sample["cameras/wrist/image_axes"], expected, atol=1e-6)
            (cut,) = cut_steps(episode, samples.inputs, [step])["cameras/wrist/image_axes"]
            np.testing.assert_array_equal(cut, sample["cameras/wrist/image_axes"])
