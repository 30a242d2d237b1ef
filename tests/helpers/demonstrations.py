"""Demonstrations that nobody made: valid episodes whose actions look like an expert's, bounds included."""

from dataclasses import replace

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode

BOUND = np.array([0.025, 0.025, 0.025, np.pi / 16])


def demonstration(index=0, task="block_picking", success=True, steps=6, size=10):
    """An episode; the same arguments give the same bytes."""
    episode = make_episode(index, steps=steps, size=size)
    rng = np.random.default_rng([7, index])
    action = np.empty((steps, 5), np.float32)
    action[:, 0] = np.arange(steps) < steps / 2
    action[:, 1:] = np.clip(rng.normal(0, BOUND / 2, (steps, 4)), -BOUND, BOUND)
    action[0, 1] = BOUND[0]
    done = {"actions/action": action, "actions/expert_action": action.copy()}
    return Episode(replace(episode.meta, task=task, success=success), episode.arrays | done)


def write(folder, episodes):
    """A dataset of episodes, numbered as they come."""
    Dataset.create_or_resume(folder, "block_picking", seed=0, config={})
    for index, episode in enumerate(episodes):
        numbered = replace(episode, meta=replace(episode.meta, index=index))
        write_episode(numbered, folder / Dataset.file_name(index))
    return folder


def demonstrations(folder, count=6, **kwargs):
    """A dataset of as many demonstrations."""
    return write(folder, [demonstration(index, **kwargs) for index in range(count)])
