"""Cost of everyday work in one table, to compare two commits: run it in a checkout of each, in turn.

    PYTHONPATH=CHECKOUT .venv/bin/python benchmarks/everyday.py

Times are CPU time of this process (of the process that opens a dataset, for the two looks), the smallest of some
rounds. Episodes are block-centering episodes of the simulation, one process, one thread.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch

from collectors.sources.centering import CenteringCollector
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import Samples
from svfl_data.storage.store import episode_bytes, write_episode
from svfl_models.networks.policy import Policy

EPISODES, COPIES, ROUNDS, BATCH = 16, 300, 3, 64
SETTLED_S = 3.0  # [s] to wait, since files that have just been written are not put into the cache
LOOK = """
import sys, time
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import Samples
begin = time.process_time()
Samples(Dataset.open(sys.argv[1]), cameras=["front"])
print(time.process_time() - begin)
"""


def least(work: Callable[[], object], per: float, rounds: int = ROUNDS) -> float:
    """Return the smallest CPU time of some rounds of work, divided by `per`, [s]."""
    found = []
    for _ in range(rounds):
        begin = time.process_time()
        work()
        found.append(time.process_time() - begin)
    return min(found) / per


def look(folder: Path) -> float:
    """Return the CPU time in which a fresh process opens all episodes of a dataset, [s]."""
    return float(subprocess.run([sys.executable, "-c", LOOK, folder], capture_output=True, check=True).stdout)


def training_step() -> Callable[[], object]:
    """Return a function that does one optimiser step of a policy of image, wrench and proprioception."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    policy = Policy("vfp")
    adam = torch.optim.Adam(policy.parameters())
    batch = {
        "image": torch.rand(BATCH, 4, 64, 64),
        "wrench": torch.randn(BATCH, 64, 6),
        "proprio": torch.randn(BATCH, 5),
    }

    def step() -> None:
        adam.zero_grad()
        policy(batch).mean.square().mean().backward()
        adam.step()

    return step


def main() -> None:
    """Measure everything and print it as JSON."""
    folder = Path(tempfile.mkdtemp())
    cache = folder / "cache"
    cache.mkdir(mode=0o700)
    os.environ["SVFL_CACHE_DIR"] = str(cache)
    try:
        collector = CenteringCollector(0)
        episodes = [collector(index) for index in range(EPISODES)]
        found = {"collect, ms CPU per episode": 1e3 * least(lambda: [collector(index) for index in range(8)], 8)}
        found["write, ms CPU per episode"] = 1e3 * least(lambda: list(map(episode_bytes, episodes)), EPISODES)
        found["file, kB per episode"] = float(np.mean([len(episode_bytes(one)) for one in episodes])) / 1e3
        dataset = Dataset.create_or_resume(folder / "data", "centering", 0, {})
        for index in range(COPIES):
            one = episodes[index % EPISODES]
            meta = replace(one.meta, index=index, seed=index // EPISODES)
            write_episode(replace(one, meta=meta), dataset.episode_path(index))
        time.sleep(SETTLED_S)
        found["first look, ms CPU per episode"] = 1e3 * look(dataset.path) / COPIES
        found["later look, ms CPU per episode"] = 1e3 * min(look(dataset.path) for _ in range(ROUNDS)) / COPIES
        for name, cached in (("random reading", False), ("RAM cache", True)):
            samples = Samples(dataset, cameras=["front"], crop=64, cache=cached)
            chosen = np.random.default_rng(0).integers(0, len(samples), (20, BATCH))
            cost = least(lambda s=samples, c=chosen: list(map(s.batch, c)), chosen.size)  # type: ignore[misc] # bound now
            found[f"{name}, us CPU per sample"] = 1e6 * cost
        found["training step, ms CPU"] = 1e3 * least(training_step(), 1, 2 * ROUNDS)
        print(json.dumps({name: round(value, 2) for name, value in found.items()}, indent=1))
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
