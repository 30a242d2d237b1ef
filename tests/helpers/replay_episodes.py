"""Episodes for the tests of the replay buffer, in which no two numbers or pixels are likely to be the same."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.replay import ReplayBuffer, ReplayConfig, ReplaySpec
from svfl_data.sampling.windows import WINDOW, wrench_window
from svfl_data.schema.action_fields import expert, planar_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.store import write_episode
from tests.helpers.builders import episode_arrays

SMALL = ReplayConfig(crop=12)
ACTION = planar_action(0.025, 0.2)


def make_demo(index: int, steps: int = 4, success: bool = True, task: str = "picking", size: int = 16, **changes):
    """A demonstration whose numbers are all different; `changes` replace arrays, ``None`` drops them."""
    rng = np.random.default_rng([7, index])
    arrays = episode_arrays(rng, steps, size)
    arrays["observations/proprio"] = rng.uniform(0.0, 1.0, (steps + 1, 5)).astype(np.float32)
    arrays["actions/action"] = rng.uniform(-0.02, 0.02, (steps, 5)).astype(np.float32)
    arrays["actions/action"][:, 0] = rng.uniform(0, 1, steps)
    arrays |= changes.get("arrays", {})
    arrays = {path: array for path, array in arrays.items() if array is not None}
    action = changes.get("action", ACTION)
    declared = Declarations([action, expert(action)])
    return Episode(Meta(task, index, 0, "expert", success), arrays, declarations=declared)


def store(folder: Path, *episodes: Episode) -> Dataset:
    """A dataset of these episodes."""
    dataset = Dataset.create_or_resume(folder, "picking", 0, {})
    for episode in episodes:
        write_episode(episode, dataset.episode_path(episode.meta.index))
    return dataset


def spec_of(episode: Episode) -> ReplaySpec:
    return ReplaySpec.of_episode(episode, episode.cameras["front"])


def observation(episode: Episode, step: int) -> dict[str, np.ndarray]:
    """What an environment would have shown at a step."""
    camera = episode.cameras["front"]
    color = camera.color[step].transpose(2, 0, 1) / np.float32(255)
    depth = camera.depth[step] * np.float32(camera.depth_scale)
    window, _ = wrench_window(episode, step, WINDOW)
    return {"image": np.concatenate([color, depth[None]]), "wrench": window, "proprio": episode.proprio[step]}


def live_through(buffer: ReplayBuffer, episode: Episode, terminated: bool | None = None, rewards=None) -> None:
    """Add an episode step by step, as an agent would."""
    done = episode.meta.success if terminated is None else terminated
    rewards = np.zeros(len(episode)) if rewards is None else rewards
    buffer.begin_episode(observation(episode, 0))
    for step in range(len(episode)):
        last = step + 1 == len(episode)
        seen = observation(episode, step + 1)
        buffer.add(episode.action[step], seen, rewards[step], last and done, last and not done)


def agent_buffer(*lengths: int, capacity: int = 100, config: ReplayConfig = SMALL) -> ReplayBuffer:
    """A buffer without demonstrations that has seen episodes of these lengths; the k-th is `make_demo(k)`."""
    episodes = [make_demo(index, steps) for index, steps in enumerate(lengths)]
    buffer = ReplayBuffer(capacity, spec_of(make_demo(0)), config)
    for episode in episodes:
        live_through(buffer, episode)
    return buffer


def small(**settings) -> ReplayConfig:
    return replace(SMALL, **settings)
