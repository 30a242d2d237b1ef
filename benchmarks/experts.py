"""Success rate and duration of the scripted experts over seeded episodes.

    .venv/bin/python benchmarks/experts.py --episodes 200 --workers 2

Every attempt counts, and none is repeated. No images are taken, which changes nothing for the experts.
"""

import argparse
import os
import platform
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from collectors.robots import DEFAULT, make
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.tasks import TASKS, task_class
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import MAX_STEPS


def attempt(index: int, name: str, seed: int, noise: float, robot: str) -> tuple[bool, int, float]:
    """Run one episode of an expert.

    Args:
        index: Number of the episode.
        name: Name of the task.
        seed: Seed of the run.
        noise: Noise of the expert, as a factor on the usual noise.
        robot: Name of the simulated robot.

    Returns:
        Whether the episode succeeded, its number of steps, and the CPU seconds that it took.
    """
    start = time.process_time()
    randomness = np.random.SeedSequence([seed, index])
    with World(WorldConfig(robot=make(robot))) as world:
        task = task_class(name).begin(world, randomness)
        moves = task.expert(Gripper(world, np.random.default_rng(randomness), noise))
        for step in range(1, MAX_STEPS + 1):
            action = next(moves, None)
            if action is None:
                return False, step, time.process_time() - start
            world.step(action)
            if task.success():
                return True, step, time.process_time() - start
    return False, MAX_STEPS, time.process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=[*TASKS, "all"], default="all")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--noise", type=float, default=1.0)
    parser.add_argument("--robot", default=DEFAULT)
    asked = parser.parse_args()
    machine = platform.processor() or platform.machine()
    print(f"{machine}, {asked.robot}, {asked.episodes} episodes, noise {asked.noise:g}")
    print("| task | success | steps, median (longest) | CPU s an episode | failures |\n| --- | --- | --- | --- | --- |")
    for name in TASKS if asked.task == "all" else [asked.task]:
        with ProcessPoolExecutor(asked.workers) as pool:
            work = partial(attempt, name=name, seed=asked.seed, noise=asked.noise, robot=asked.robot)
            results = list(pool.map(work, range(asked.episodes), chunksize=4))
        steps = [count for success, count, _ in results if success] or [0]
        failed = [index for index, (success, _, _) in enumerate(results) if not success]
        print(
            f"| {name} | {100 * (1 - len(failed) / len(results)):.1f} % | {np.median(steps):.0f} ({max(steps)}) "
            f"| {np.mean([seconds for *_, seconds in results]):.2f} | {failed or ''} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
