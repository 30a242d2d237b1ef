"""Narrow networks, drawn batches and written datasets for the tests of latent pretraining."""

import dataclasses

import numpy as np
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models.latent.config import Sizes, plain
from svfl_models.latent.networks.network import LatentNetwork
from tests.helpers.builders import make_episode

SIZES = Sizes(
    feature=16, z1=4, z2=8, hidden=16, dim=16, depth=2, heads=2, token=(8, 4), joined=16, image=(2, 2, 4, 4),
    wrench=(4,) * 6, proprio=(4, 4), concat=(8, 4, 4), decoder=(4, 4, 4, 4), heads_hidden=8,
)  # fmt: skip
LIFT_FROM = 7
"""First step of a written episode in which its object is moved."""


def network(model: str, train: bool = False) -> LatentNetwork:
    """A narrow model, the same for the same name."""
    torch.manual_seed(0)
    return LatentNetwork(model, plain(SIZES)).train(train)


def batch(sequences: int = 4, frames: int = 4, seed: int = 0) -> dict[str, torch.Tensor]:
    """A batch of sequences, of numbers that mean nothing."""
    rng = torch.Generator().manual_seed(seed)
    shape, actions = (sequences, frames), (sequences, frames - 1)

    def uniform(*sizes: int) -> torch.Tensor:
        return torch.rand(sizes, generator=rng)

    return {
        "image": uniform(*shape, 4, 64, 64) + 0.01,
        "wrench": uniform(*shape, 64, 6) - 0.5,
        "proprio": uniform(*shape, 5) - 0.5,
        "action": (uniform(*actions, 5) - 0.5) * 0.04,
        "reward": (uniform(*actions) > 0.5).float(),
        "contact": (uniform(*shape) > 0.5).float(),
        "next_contact": (uniform(*actions) > 0.5).float(),
        "touching": torch.ones(shape, dtype=torch.bool),
        "episode": torch.arange(sequences),
        "step": torch.arange(frames).expand(shape),
    }


def frames(count: int = 3, seed: int = 0) -> dict[str, torch.Tensor]:
    """Observations, one leading dimension."""
    drawn = batch(1, count, seed)
    return {name: drawn[name][0] for name in ("image", "wrench", "proprio")}


def lifting(index: int, steps: int = 10, **meta: object):
    """A short episode whose object is lifted from step `LIFT_FROM` on; only then is there a force at the end."""
    episode = make_episode(index, steps=steps, size=76)
    pose = episode.arrays["streams/object/pose"].copy()
    pose[LIFT_FROM + 1 :, 2] += 0.02 * np.arange(1, steps - LIFT_FROM + 1)
    arrays = episode.arrays | {"streams/object/pose": pose}
    about = dataclasses.replace(episode.meta, **{"task": "block_picking"} | meta)
    return dataclasses.replace(episode, meta=about, arrays=arrays)


def written(folder, episodes, task: str = "block_picking"):
    """A dataset of these episodes; returns its folder."""
    Dataset.create_or_resume(folder, task, seed=0, config={})
    for episode in episodes:
        write_episode(episode, folder / f"episode_{episode.meta.index:06d}.hdf5")
    return folder
