"""Cost of the first look at a dataset, and of a later one: `Samples` of the dataset, in fresh processes.

The first look hashes every episode, has it examined by another process and checks it; the result goes to the user's
cache (here: a temporary one). A later look finds it there. The datasets are copies of the episodes of another dataset,
which the system already has in memory. Times are CPU seconds of a process, and of those that it started.

python benchmarks/open.py [--data data/centering] [--sizes 200 2000] [--rounds 3]
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

from svfl_data.datasets.dataset import Dataset

SETTLED_S = 3.0  # [s] to wait, since files that have just been written are not put into the cache
LOOK = """
import resource, sys, time
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import Samples
def cpu():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
begin, used = time.perf_counter(), cpu()
samples = Samples(Dataset.open(sys.argv[1]))
print(time.perf_counter() - begin, cpu() - used)
"""


def look(folder: Path, cache: Path) -> tuple[float, float, float]:
    """Return the wall seconds, CPU seconds, and CPU seconds of the examining process of one look.

    Args:
        folder: Folder of the dataset.
        cache: Folder of the cache.
    """
    before = children()
    done = subprocess.run(
        [sys.executable, "-c", LOOK, folder], env=os.environ | {"SVFL_CACHE_DIR": str(cache)}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    wall, own = map(float, done.stdout.split())
    return wall, own, max(0.0, children() - before - own)


def children() -> float:
    """Return the CPU seconds of all processes that this process started and that have ended."""
    used = os.times()
    return used.children_user + used.children_system


def copied(source: Dataset, count: int, folder: Path) -> Path:
    """Create a dataset whose episodes are copies of another dataset's episodes, used repeatedly.

    Args:
        source: Dataset to copy episodes from.
        count: Number of episodes.
        folder: Folder of the new dataset.

    Returns:
        The folder of the new dataset.
    """
    target = Dataset.create_or_resume(folder, source.info["task"], source.info["seed"], source.info["config"])
    indices = source.indices
    for number in range(count):
        shutil.copyfile(source.episode_path(indices[number % len(indices)]), target.episode_path(number))
    return folder


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data/centering"))
    parser.add_argument("--sizes", type=int, nargs="+", default=[200, 2000])
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    versions = f"Python {platform.python_version()}, h5py {h5py.__version__}, NumPy {np.__version__}"
    print(f"{os.cpu_count()} cores, {versions}, load {os.getloadavg()[0]:.1f}\n")
    print("| episodes | opening | s | CPU s | CPU ms per episode | CPU s of other processes |")
    print("| ---: | --- | ---: | ---: | ---: | ---: |")
    for count in arguments.sizes:
        with tempfile.TemporaryDirectory() as scratch:
            folder = copied(Dataset.open(arguments.data), count, Path(scratch) / "data")
            time.sleep(SETTLED_S)
            looks = {"first": [], "later": []}
            for number in range(arguments.rounds):
                cache = Path(scratch) / f"cache_{number}"
                looks["first"].append(look(folder, cache))
                looks["later"].append(look(folder, cache))
            for name, found in looks.items():
                wall, own, others = np.median(found, axis=0)
                print(f"| {count} | {name} | {wall:.2f} | {own:.2f} | {1000 * own / count:.2f} | {others:.2f} |")


if __name__ == "__main__":
    main()
