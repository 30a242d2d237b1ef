"""Cost of reading: random samples by every available way, and opening datasets of growing size.

Samples are a cropped 4 x 64 x 64 image (RGB uint8, depth uint16), a 64 x 6 wrench window, proprio and action, drawn at
random over the whole dataset, in one process, from files that the system already has in memory. Figures are per CPU
second; all rows are measured in turn, round by round, so that a busy machine slows all of them alike.

python benchmarks/store.py [--data data/centering] [--rounds 7] [--sizes 100 1000 10000]
"""

import argparse
import itertools
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import INDEX, describe
from svfl_data.maintenance.pack import pack
from svfl_data.sampling.samples import Samples
from svfl_data.schema.episode import canonical_json
from svfl_data.storage.chunks import Extent

BATCH = 64
CROP = 64
WINDOW = 64
PLAIN, COPY = "plain h5py, item by item, files kept open", "memory copy of the same bytes"
Fetch = Callable[[np.ndarray], object]


def per_item(dataset: Dataset, samples: Samples, keep_open: bool) -> Fetch:
    """Return a function that slices every array of every sample with h5py, as robomimic does without a cache.

    The function stacks the samples to a batch.

    Args:
        dataset: Dataset to read the samples from.
        samples: Samples of the dataset, which give the episode and step of each index.
        keep_open: Whether the files stay open (robomimic's one file does; thousands of files cannot).
    """
    places = samples.batch(np.arange(len(samples)))
    episodes, steps = places["episode"].tolist(), places["step"].tolist()
    paths = {index: str(dataset.episode_path(index)) for index in dataset.indices}
    opened = {index: h5py.File(path, "r") for index, path in paths.items()} if keep_open else {}

    def fetch(indices: np.ndarray) -> object:
        return collate([one(episodes[index], steps[index]) for index in indices.tolist()])

    def one(episode: int, step: int) -> dict[str, np.ndarray]:
        if keep_open:
            return cut(opened[episode], step)
        with h5py.File(paths[episode], "r") as file:
            return cut(file, step)

    def cut(file: h5py.File, step: int) -> dict[str, np.ndarray]:
        now = file["observations/t_ns"][step]
        frame = int(np.searchsorted(file["cameras/front/t_ns"][:], now, side="right")) - 1
        end = int(np.searchsorted(file["streams/wrench/t_ns"][:], now, side="right"))
        top, left = ((size - CROP) // 2 for size in file["cameras/front/color"].shape[1:3])
        rectangle = (slice(top, top + CROP), slice(left, left + CROP))
        wrench = file["streams/wrench/wrench"][max(0, end - WINDOW) : end] - file["streams/wrench/tare"][:]
        return {
            "color": file["cameras/front/color"][frame][rectangle],
            "depth": file["cameras/front/depth"][frame][rectangle],
            "wrench": wrench.astype(np.float32),
            "proprio": file["observations/proprio"][step],
            "action": file["actions/action"][step],
        }

    return fetch


def collate(items: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Stack samples to a batch, as PyTorch's default collation does."""
    return {key: np.stack([item[key] for item in items]) for key in items[0]}


def copying(samples: Samples) -> Fetch:
    """Return a function that copies as many bytes as a batch of these samples has, between two places of memory."""
    size = sum(values.nbytes for values in samples.batch(np.arange(BATCH)).values())
    source = np.random.default_rng(0).integers(0, 256, (64, size), dtype=np.uint8)  # larger than the CPU's caches
    target = np.empty_like(source)
    turn = itertools.cycle(range(len(source)))

    def fetch(indices: np.ndarray) -> object:
        row = next(turn)
        target[row] = source[row]
        return target

    return fetch


def throughput(ways: dict[str, Fetch], samples: int, rounds: int, seconds: float = 0.5) -> dict[str, np.ndarray]:
    """Return the samples per CPU second of each way in each round.

    Args:
        ways: Functions that read a batch of sample indices, by name.
        samples: Number of samples in the dataset.
        rounds: Number of rounds that count, after a first one that fills the caches.
        seconds: CPU seconds for which a way is run in a round.

    Returns:
        The rates of each way, (rounds,), by name.
    """
    rates: dict[str, list[float]] = {name: [] for name in ways}
    rng = np.random.default_rng(0)
    for round_ in range(rounds + 1):
        for name, fetch in ways.items():
            order = rng.integers(0, samples, (64, BATCH))
            done, start = 0, time.process_time()
            while time.process_time() - start < seconds:
                fetch(order[done % len(order)])
                done += 1
            if round_:  # the first one fills the caches
                rates[name].append(done * BATCH / (time.process_time() - start))
    return {name: np.array(values) for name, values in rates.items()}


def reading(folder: Path, rounds: int, scratch: Path) -> None:
    """Print the table of random reading.

    Args:
        folder: Folder of the dataset.
        rounds: Number of rounds to measure.
        scratch: Folder for temporary copies.
    """
    dataset = Dataset.open(folder)
    packed = pack(dataset, scratch / "packed")
    cut = {"crop": CROP, "windows": {"streams/wrench/wrench": WINDOW}}
    sealed, shards = Samples(dataset, **cut), Samples(packed, **cut)
    cached, random = Samples(dataset, cache=True, **cut), Samples(dataset, cache=True, crop_at="random", **cut)
    ways: dict[str, Fetch] = {
        "plain h5py, item by item": per_item(dataset, sealed, keep_open=False),
        PLAIN: per_item(dataset, sealed, keep_open=True),
        "sealed files": sealed.batch,
        "shards": shards.batch,
        "RAM cache, whole batches": cached.batch,
        "RAM cache, random crops": random.batch,
        "RAM cache, item by item": lambda indices: collate([cached[index] for index in indices.tolist()]),
        COPY: copying(cached),
    }
    size = sum(values.nbytes for values in cached.batch(np.arange(BATCH)).values()) / BATCH
    rates = throughput(ways, len(sealed), rounds)
    base, limit = (np.median(rates[name]) for name in (PLAIN, COPY))
    print(
        f"Random reading: {len(sealed)} samples of {len(dataset)} episodes, {size / 1e3:.1f} kB each, {BATCH} a batch\n"
    )
    print("| method | samples per CPU second (lowest..highest round) | x h5py (open) | of memory copy |")
    print("| --- | ---: | ---: | ---: |")
    for name, values in rates.items():
        middle = np.median(values)
        print(
            f"| {name} | {middle:,.0f} ({values.min():,.0f}..{values.max():,.0f}) | {middle / base:.1f} "
            f"| {100 * middle / limit:.1f} % |"
        )
    print()


MEASURE = """
import sys, time
import svfl_data.datasets.index
from svfl_data.datasets.dataset import Dataset
peak = lambda: int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]) / 1024
before, start, cpu = peak(), time.perf_counter(), time.process_time()
if sys.argv[2] == "open":
    repr(Dataset.open(sys.argv[1]))
else:
    svfl_data.datasets.index.summary(Dataset.open(sys.argv[1]))
print(time.perf_counter() - start, time.process_time() - cpu, peak(), peak() - before)
"""


def measured(folder: Path, what: str) -> tuple[str, str]:
    """Return wall and CPU seconds, and peak memory, of one operation in a fresh process, as texts for the table.

    Args:
        folder: Folder of the dataset.
        what: ``open`` to open the dataset, or ``summary`` to summarize it.
    """
    command = [sys.executable, "-c", MEASURE, folder, what]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
    seconds, cpu, peak, growth = map(float, done.stdout.split())
    return f"{seconds:.3f} ({cpu:.3f})", f"{peak:.0f} (+{growth:.0f})"


def growing(folder: Path, sizes: list[int], scratch: Path) -> None:
    """Print the table of opening and summarizing datasets.

    Their episodes are hard links to copies of one dataset's episodes, used in turn.

    Args:
        folder: Folder of the dataset whose episodes are used.
        sizes: Numbers of episodes of the datasets.
        scratch: Folder for temporary datasets.
    """
    dataset = Dataset.open(folder)
    (scratch / "sources").mkdir()
    sources = [Path(shutil.copy(dataset.episode_path(index), scratch / "sources")) for index in dataset.indices]
    start = time.process_time()
    described = [describe(Extent.of_file(source)) for source in sources]
    building = 1e3 * (time.process_time() - start) / len(sources)
    info = dataset.info
    print("Opening (`repr(Dataset.open(path))`) and summarising (what `svfl-data info` prints), in fresh processes;")
    print("peak memory with growth over the bare imports. The index is there already; building it takes, once,")
    print(f"{building:.1f} ms of CPU per episode.\n")
    print("| episodes | open, s (CPU) | memory, MB | packed: open, s (CPU) | summary, s (CPU) | memory, MB |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for size in sizes:
        large = Dataset.create_or_resume(scratch / f"{size}", info["task"], info["seed"], info["config"])
        for index in range(size):
            os.link(sources[index % len(sources)], large.episode_path(index))
        lines = (replace(described[i % len(sources)], name=large.file_name(i), index=i) for i in range(size))
        (large.path / INDEX).write_text("".join(canonical_json(asdict(line)) + "\n" for line in lines))
        packed = pack(large, scratch / f"{size}-packed")
        opened, open_memory = measured(large.path, "open")
        packed_opened, _ = measured(packed.path, "open")
        summed, sum_memory = measured(large.path, "summary")
        print(f"| {size:,} | {opened} | {open_memory} | {packed_opened} | {summed} | {sum_memory} |", flush=True)
        shutil.rmtree(packed.path)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data/centering"), help="dataset to read")
    parser.add_argument("--rounds", type=int, default=7, help="number of repeated measurements")
    parser.add_argument("--sizes", type=int, nargs="*", default=[100, 1000, 10000], help="numbers of episodes to open")
    parser.add_argument("--scratch", type=Path, help="folder for copies (default: the system's temporary one)")
    args = parser.parse_args()
    versions = f"Python {platform.python_version()}, h5py {h5py.__version__}, NumPy {np.__version__}"
    print(f"{os.cpu_count()} x {cpu_name()}, {platform.system()}, {versions}, load {os.getloadavg()[0]:.1f}")
    print(f"`python benchmarks/store.py {' '.join(sys.argv[1:])}`\n")
    with tempfile.TemporaryDirectory(dir=args.scratch) as scratch:
        reading(args.data, args.rounds, Path(scratch))
        if args.sizes:
            growing(args.data, args.sizes, Path(scratch))


def cpu_name() -> str:
    """Return the name of the processor, as Linux gives it."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


if __name__ == "__main__":
    main()
