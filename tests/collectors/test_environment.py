"""The tasks as gymnasium environments: gymnasium's own contract, and ours."""

import warnings
from contextlib import closing
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from collectors.environment import Environment, normalised
from collectors.simulation import CameraConfig, WorldConfig
from collectors.simulation.camera import CAMERAS
from collectors.tasks import TASKS
from collectors.tasks.task import MAX_STEPS
from svfl_data.errors import UsageError

SMALL = WorldConfig(cameras={"front": CameraConfig(height=24, width=24)})


@pytest.mark.parametrize("task", TASKS)
def test_every_task_passes_gymnasiums_check(task):
    env = gymnasium.make(f"svfl/{task}-v0", world=SMALL, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.filterwarnings("error", category=UserWarning)
        warnings.filterwarnings("ignore", message=r".*(infinity|-inf|inf).*")  # a wrench has no bounds
        check_env(env.unwrapped)
    env.close()


@pytest.fixture
def env():
    env = Environment("block_picking", SMALL)
    yield env
    env.close()


def test_spaces_are_the_papers(env):
    assert env.observation_space["image"].shape == (4, 24, 24)
    assert env.observation_space["wrench"].shape == (64, 6)
    assert env.observation_space["proprio"].shape == (5,)
    assert env.wrench_hz == 500
    np.testing.assert_allclose(env.action_space.low, [0, -0.025, -0.025, -0.025, -np.pi / 16], rtol=1e-6)
    np.testing.assert_allclose(env.action_space.high, [1, 0.025, 0.025, 0.025, np.pi / 16], rtol=1e-6)


def test_the_expert_is_rewarded_once_at_the_end(env):
    env.reset(seed=1)
    rewards = []
    for action in env.expert(seed=1):
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
        assert info["success"] == terminated == (reward == 1.0)
        if terminated or truncated:
            break
    assert rewards[-1] == 1.0
    assert not any(rewards[:-1])
    assert not truncated


def test_an_idle_episode_is_truncated_after_50_steps(env):
    env.reset(seed=1)
    ends = [env.step(np.array([1, 0, 0, 0, 0], np.float32))[2:4] for _ in range(MAX_STEPS)]
    assert ends == [(False, False)] * (MAX_STEPS - 1) + [(False, True)]


def test_a_seed_is_a_scene(env):
    first, _ = env.reset(seed=5)
    second, _ = env.reset()
    again, _ = env.reset(seed=5)
    for name in first:
        np.testing.assert_array_equal(first[name], again[name])
    assert not np.array_equal(first["image"], second["image"])


def test_the_wrench_window_is_the_latest_readings_tared(env):
    env.reset(seed=2)
    for _ in range(3):
        observation, *_ = env.step(np.array([1, 0, 0, -0.02, 0], np.float32))
    expected = env.world.wrench[-64:] - env.world.tare_offset
    np.testing.assert_array_equal(observation["wrench"], expected)


def test_the_view_from_above_is_centred_on_the_workspace():
    """Seen from above, the block's pixels are at its place in image-aligned axes."""
    env = Environment("block_picking", view="top")
    observation, _ = env.reset(seed=3)
    red, _, blue, depth = observation["image"]
    rows, columns = np.nonzero((blue > 2 * red) & (depth > 0))
    offset = env.image_axes @ (np.array(env.task.scene.xy) - env.world.workspace[:2].mean(axis=1))
    metres = 0.4 / len(red)
    seen = np.array([columns.mean() - (len(red) - 1) / 2, (len(red) - 1) / 2 - rows.mean()]) * metres
    np.testing.assert_allclose(seen, offset, atol=0.015)
    env.close()


def test_normalised_actions_reach_the_bounds():
    env = normalised(Environment("block_picking", SMALL))
    env.reset(seed=0)
    start = env.unwrapped.world.target
    env.step(np.array([1, 1, -1, -1, 1], np.float32))
    moved = env.unwrapped.world.target - start
    np.testing.assert_allclose(moved, [0.025, -0.025, -0.025, np.pi / 16], atol=1e-6)
    env.close()


def test_mistakes_are_clear(env):
    with pytest.raises(UsageError, match=r"step .*reset"):
        env.step(np.zeros(5, np.float32))
    with pytest.raises(UsageError, match=r"expert .*reset"):
        env.expert()
    env.reset(seed=0)
    with pytest.raises(UsageError, match="5 finite numbers"):
        env.step(np.array([1, np.nan, 0, 0, 0], np.float32))
    with pytest.raises(UsageError, match=r"task 'juggling'.* block_picking"):
        Environment("juggling")
    with pytest.raises(UsageError, match=r"view 'below'.* camera, top"):
        Environment("block_picking", view="below")


def test_the_camera_that_is_named_is_observed():
    """Whatever others there are, and in whatever order."""
    small = {name: replace(CAMERAS[name], height=24, width=24) for name in ("top", "front")}
    observed = {}
    for camera, cameras in (("front", small), ("front", dict(reversed(small.items()))), ("top", small)):
        with closing(Environment("block_picking", WorldConfig(cameras=cameras), camera=camera)) as env:
            image = env.reset(seed=0)[0]["image"]
            np.testing.assert_array_equal(env.image_axes, env.world.cameras[camera].image_axes)
        assert np.array_equal(observed.setdefault(camera, image), image)
    assert not np.array_equal(observed["front"], observed["top"])


def test_a_named_camera_of_the_simulation_needs_no_world():
    with closing(Environment("block_picking", camera="side_left")) as env:
        assert list(env.world.cameras) == ["side_left"]


def test_cameras_that_are_not_named_or_not_there_are_refused():
    two = WorldConfig(cameras={name: CAMERAS[name] for name in ("top", "front")})
    for world, camera, facts in ((two, None, "camera=.*top, front"), (two, "wrist", "'wrist'.*top, front")):
        with pytest.raises(UsageError, match=facts):
            Environment("block_picking", world, camera=camera)
