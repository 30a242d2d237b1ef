"""What the environments observe belongs into a replay buffer that was preloaded with demonstrations."""

from dataclasses import replace

import numpy as np
import pytest

from collectors.environment import Environment
from collectors.simulation import WorldConfig
from collectors.simulation.camera import CAMERAS
from collectors.sources.expert import ExpertCollector
from collectors.tasks.task import MAX_STEPS, attempt_seed
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.replay import ReplayBuffer, ReplayConfig, ReplaySpec
from svfl_data.schema.input_spec import InputSpec
from svfl_data.storage.store import write_episode
from tests.helpers.collectors import SMALL

CONFIG = ReplayConfig(crop=12, expert_bonus=0.0)
IDLE = np.array([1, 0, 0, 0, 0], np.float32)


@pytest.fixture
def env():
    env = Environment("block_picking", SMALL)
    yield env
    env.close()


def again(env: Environment, buffer: ReplayBuffer, episode) -> tuple[bool, bool]:
    """Do in an environment what was demonstrated, in the same scene; how it ended."""
    seed = attempt_seed(episode.meta.seed, episode.meta.index, episode.meta.config["attempt"])
    observation, _ = env.reset(options={"seed_sequence": seed})
    buffer.begin_episode(observation)
    for action in episode.action:
        observation, reward, terminated, truncated, _ = env.step(action)
        buffer.add(action, observation, reward, terminated, truncated)
    return terminated, truncated


def test_the_layout_of_an_environment_is_that_of_its_demonstrations(env, picked):
    buffer = ReplayBuffer.from_demos(Dataset.open(picked), 1, config=CONFIG)
    assert buffer.spec == ReplaySpec.of_environment(env, "block_picking")
    observation, _ = env.reset(seed=0)
    buffer.begin_episode(observation, spec=ReplaySpec.of_environment(env, "block_picking"))
    env.view = "top"
    with pytest.raises(DatasetError, match=r"view .*top, .*[\d.]+ m.* camera"):
        buffer.begin_episode(observation, spec=ReplaySpec.of_environment(env, "block_picking"))


def test_what_is_lived_through_equals_what_was_recorded(env, picked):
    """Same shapes, units, axes, dtypes, rewards and end: the same batch, whichever way the episode came."""
    dataset = Dataset.open(picked)
    shown = ReplayBuffer.from_demos(dataset, 1, config=CONFIG)
    lived = ReplayBuffer(shown.capacity, shown.spec, CONFIG)
    assert again(env, lived, dataset.read(0)) == (True, False)
    assert len(lived) == len(shown)
    batch, other = shown.sample(64), lived.sample(64)
    assert batch.keys() == other.keys()
    for name in batch.keys() - {"expert"}:
        assert batch[name].dtype == other[name].dtype
        np.testing.assert_allclose(batch[name], other[name], rtol=0, atol=1e-6, err_msg=name)


@pytest.mark.slow
def test_a_camera_on_the_gripper_is_lived_through_as_it_was_recorded(tmp_path):
    """The pictures, their axes and the vectors, turned alike, whichever way the episode came."""
    world = WorldConfig(cameras={name: replace(CAMERAS[name], height=16, width=16) for name in ("front", "wrist")})
    inputs = InputSpec(("front", "wrist"), 2, vectors=("observations/proprio",))
    config = ReplayConfig(crop=12, expert_bonus=0.0, rotate=True, group_order=8)
    expert = ExpertCollector(0, "block_picking", world=world)
    dataset = Dataset.create_or_resume(tmp_path / "d", "block_picking", 0, expert.config())
    write_episode(expert(0), dataset.episode_path(0))
    expert.opened.close()
    shown = ReplayBuffer.from_demos(dataset, 1, inputs=inputs, config=config)
    lived = ReplayBuffer(shown.capacity, shown.spec, config)
    env = Environment("block_picking", world, inputs=inputs)
    assert again(env, lived, dataset.read(0)) == (True, False)
    env.close()
    batch, other = shown.sample(64), lived.sample(64)
    assert batch.keys() == other.keys()
    for name in batch.keys() - {"expert"}:
        if not name.endswith(("/padding", "/age")):  # which an environment does not give
            np.testing.assert_allclose(batch[name], other[name], rtol=0, atol=1e-6, err_msg=name)
    axes = batch["cameras/wrist/image_axes"].astype(float)
    assert axes.shape == (64, 2, 2, 2)
    assert np.abs(axes[:, 0] - axes[:, 1]).max() > 1e-3, "the camera turned between two frames"


def test_demonstrations_and_experience_are_drawn_together_and_only_success_is_final(env, picked):
    dataset = Dataset.open(picked)
    buffer = ReplayBuffer.from_demos(dataset, 3, config=CONFIG)
    demonstrated = len(buffer)
    observation, _ = env.reset(seed=1)
    buffer.begin_episode(observation)
    truncated = False
    while not truncated:
        observation, reward, terminated, truncated, _ = env.step(IDLE)
        assert not terminated
        buffer.add(IDLE, observation, reward, terminated, truncated)
    assert len(buffer) == demonstrated + MAX_STEPS
    ends = np.cumsum([len(dataset.episode(index)) for index in range(3)]) - 1
    batch = buffer.sample(8 * len(buffer))
    np.testing.assert_array_equal(batch["expert"], batch["index"] < demonstrated)
    assert {True, False} == set(batch["expert"].tolist())
    assert len(buffer) - 1 in batch["index"]
    np.testing.assert_array_equal(batch["discount"] == 0, np.isin(batch["index"], ends))
    np.testing.assert_array_equal(batch["reward"], np.isin(batch["index"], ends))
