"""What collecting costs: environment steps per CPU second, and where the time goes.

    .venv/bin/python benchmarks/collect.py --samples 20

One process, CPU time. The parts are measured by clocking the functions that do them, in a second pass over the same
samples, so that the clocks do not slow the rate that is reported.
"""

import argparse
import os
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collectors.centering import CenteringCollector
from collectors.simulation import world as world_module
from collectors.simulation.admittance import Admittance
from collectors.simulation.camera import Camera
from collectors.simulation.noise import SensorNoise
from collectors.simulation.panda import Panda
from svfl_data import store
from svfl_data.store import write_episode

PARTS = (
    ("physics", world_module.pybullet, "stepSimulation"),
    ("control", Panda, "drive"),
    ("control", Panda, "read"),
    ("control", Admittance, "step"),
    ("sensor", world_module, "wrench_from_reaction"),
    ("sensor", SensorNoise, "__call__"),
    ("render", Camera, "render"),
    ("write", store, "episode_bytes"),
    ("write", store, "write_atomically"),
    ("load arm", Panda, "__init__"),
)


@contextmanager
def clocks() -> Iterator[dict[str, float]]:
    """Count the CPU seconds of each part while the context lasts; parts never contain each other."""
    spent: dict[str, float] = defaultdict(float)

    def clocked(part: str, function):
        def call(*args, **kwargs):
            start = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[part] += time.process_time() - start

        return call

    with ExitStack() as stack:
        for part, owner, name in PARTS:
            stack.enter_context(patch.object(owner, name, clocked(part, getattr(owner, name))))
        yield spent


def collect(samples: int, folder: Path) -> tuple[int, float]:
    """Collect samples; returns environment steps (rejected attempts included) and CPU seconds."""
    collector = CenteringCollector(seed=0)
    steps = 0
    start = time.process_time()
    for index in range(samples):
        episode = collector(index)
        write_episode(episode, folder / f"{index}.hdf5")
        steps += len(episode)
    return steps, time.process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=20)
    samples = parser.parse_args().samples
    with tempfile.TemporaryDirectory() as folder:
        collect(1, Path(folder))  # warm caches
        steps, seconds = collect(samples, Path(folder))
        with clocks() as spent:
            _, clocked_seconds = collect(samples, Path(folder))
    print(f"{platform.processor() or platform.machine()}, {samples} samples, {steps} steps of kept episodes")
    print(f"{steps / seconds:.0f} env steps per CPU second, {1000 * seconds / samples:.0f} ms CPU per sample")
    spent["other"] = clocked_seconds - sum(spent.values())
    print("\n| part | ms per env step | share |\n| --- | --- | --- |")
    for part, cost in sorted(spent.items(), key=lambda item: -item[1]):
        print(f"| {part} | {1000 * cost / steps:.2f} | {100 * cost / clocked_seconds:.0f} % |")


if __name__ == "__main__":
    main()
