"""Cost of a replay buffer with demonstrations in loading, memory and drawing, beside other ways to have one.

    python benchmarks/replay.py --data data/block_picking [--episodes 50] [--rounds 7]

Every way is filled with the same demonstrations and gives the same batch: 64 transitions, chosen by priority, with
importance weights, both images cropped at one place and scaled (4 x 64 x 64 float32), both wrench windows,
proprioception and action; then the priorities of the batch are updated. `list` is a plain Python list of transitions
that each hold their observations (a next observation is the same object as the following one's), with an array of
priorities. `tianshou` is its `PrioritizedReplayBuffer` (`pip install 'svfl[bench]'`), whose batches of whole images are
cut to the same batch afterwards; `lean` is without next observations. Loading and memory are measured in separate
processes. Drawing is measured in turn, round by round, so that a busy machine slows all ways alike. Times are CPU times
of one thread.
"""

import argparse
import importlib.metadata
import importlib.util
import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.replay import ReplayBuffer, ReplayConfig, ReplaySpec
from svfl_data.sampling.windows import WINDOW, wrench_window
from svfl_data.schema.episode import Episode

BATCH, CROP = 64, 64
ALPHA, BETA, GAMMA = 0.6, 0.4, 0.99
KEPT = ("cameras/front/color", "cameras/front/depth", "observations/proprio", "actions/action", "streams/wrench/wrench")
Draw = Callable[[], dict[str, np.ndarray]]


class Ours:
    """Replay buffer of `svfl_data.replay`, filled with demonstrations.

    Args:
        dataset: Dataset to read the demonstrations from.
        episodes: Number of demonstrations to read.
        settings: Settings of the buffer's `ReplayConfig`.
    """

    def __init__(self, dataset: Dataset, episodes: int, **settings) -> None:
        self.buffer = ReplayBuffer.from_demos(dataset, episodes, config=ReplayConfig(**settings))
        self.nbytes = self.buffer.nbytes

    def __call__(self) -> dict[str, np.ndarray]:
        """Draw a batch and update the priorities of its transitions."""
        batch = self.buffer.sample(BATCH)
        self.buffer.update_priorities(batch["index"], batch["proprio"][:, 1])
        return batch


class PlainList:
    """List of transitions and an array of their priorities.

    Args:
        dataset: Dataset to read the demonstrations from.
        episodes: Number of demonstrations to read.
    """

    def __init__(self, dataset: Dataset, episodes: int) -> None:
        self.transitions, self.scale = [], 1.0
        for episode in first(dataset, episodes):
            seen, actions, self.scale = observations(episode)
            for step, action in enumerate(actions):
                over = step + 1 == len(actions)
                outcome = {"action": action, "reward": np.float32(over), "discount": np.float32(0 if over else GAMMA)}
                self.transitions.append((seen[step], seen[step + 1], outcome))
        self.priority, self.rng = np.full(len(self.transitions), 2**ALPHA), np.random.default_rng(0)
        arrays = {id(v): v.nbytes for before, after, _ in self.transitions for o in (before, after) for v in o.values()}
        self.nbytes = sum(arrays.values()) + sum(v.nbytes for *_, last in self.transitions for v in last.values())

    def __call__(self) -> dict[str, np.ndarray]:
        """Draw a batch and update the priorities of its transitions."""
        share = self.priority / self.priority.sum()
        index = self.rng.choice(len(self.transitions), BATCH, p=share)
        drawn = [self.transitions[i] for i in index.tolist()]
        batch = {name: np.stack([before[name] for before, _, _ in drawn]) for name in drawn[0][0]}
        batch |= {f"next_{name}": np.stack([after[name] for _, after, _ in drawn]) for name in drawn[0][1]}
        batch |= {name: np.stack([last[name] for *_, last in drawn]) for name in drawn[0][2]}
        weight = (len(share) * share[index]) ** -BETA
        batch |= {"weight": weight / weight.max(), "index": index}
        self.priority[index] = (np.abs(batch["proprio"][:, 1]) + 1e-6 + 1) ** ALPHA
        return cropped(batch, self.scale, self.rng)


class Tianshou:
    """Prioritized replay buffer of tianshou, filled with demonstrations.

    Args:
        dataset: Dataset to read the demonstrations from.
        episodes: Number of demonstrations to read.
        lean: Whether to leave out next observations and use the following observation instead, which does not exist
            where an episode was cut off.
    """

    def __init__(self, dataset: Dataset, episodes: int, lean: bool) -> None:
        from tianshou.data import Batch, PrioritizedReplayBuffer

        self.rng, steps = np.random.default_rng(0), steps_of(dataset, episodes)
        self.buffer = PrioritizedReplayBuffer(steps, alpha=ALPHA, beta=BETA, ignore_obs_next=lean)
        for episode in first(dataset, episodes):
            seen, actions, self.scale = observations(episode)
            for step, action in enumerate(actions):
                over = step + 1 == len(actions)
                self.buffer.add(
                    Batch(obs=seen[step], obs_next=seen[step + 1], act=action, rew=float(over), terminated=over,
                          truncated=False, info={})
                )  # fmt: skip
        stored = self.buffer._meta
        arrays = [stored[name] for name in ("act", "rew", "terminated", "truncated", "done")]
        arrays += [values for name in ("obs", "obs_next") if name in stored for values in stored[name].values()]
        self.nbytes = sum(values.nbytes for values in arrays)

    def __call__(self) -> dict[str, np.ndarray]:
        """Draw a batch and update the priorities of its transitions."""
        drawn, index = self.buffer.sample(BATCH)
        self.buffer.update_weight(index, np.abs(drawn.obs.proprio[:, 1]) + 1)
        batch = dict(drawn.obs.items()) | {f"next_{name}": values for name, values in drawn.obs_next.items()}
        discount = np.where(drawn.terminated, 0, GAMMA).astype(np.float32)
        batch |= {"action": drawn.act, "reward": drawn.rew, "discount": discount, "weight": drawn.weight}
        return cropped(batch | {"index": index}, self.scale, self.rng)


def first(dataset: Dataset, episodes: int) -> list[Episode]:
    """Return the first demonstrations of a dataset."""
    return [dataset.read(index) for index in dataset.indices[:episodes]]


def steps_of(dataset: Dataset, episodes: int) -> int:
    """Return the number of transitions in the first demonstrations of a dataset."""
    return sum(len(dataset.episode(index)) for index in dataset.indices[:episodes])


def observations(episode: Episode) -> tuple[list[dict[str, np.ndarray]], np.ndarray, float]:
    """Return each observation with arrays of its own, the actions and the depth scale, in image-aligned axes."""
    (camera,) = episode.cameras.values()
    spec = ReplaySpec.of_episode(episode, camera)
    proprio = spec.kept("proprio", episode.proprio)
    seen = [
        {
            "color": np.ascontiguousarray(camera.color[step].transpose(2, 0, 1)),
            "depth": camera.depth[step].copy(),
            "wrench": spec.kept("wrench", wrench_window(episode, step, WINDOW)[0]),
            "proprio": proprio[step].copy(),
        }
        for step in range(len(episode.t_ns))
    ]
    return seen, spec.kept("action", episode.action), spec.depth_scale


def cropped(batch: dict[str, np.ndarray], scale: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Crop the images of a batch, at one place for s and s', and scale them, as `svfl_data.replay` does.

    Args:
        batch: Batch with ``color`` and ``depth`` and the same of the next observation.
        scale: Metres per unit of depth, [m].
        rng: Generator that the places of the crops are drawn from.

    Returns:
        The batch with ``image`` and ``next_image`` in place of colour and depth images.
    """
    size = batch["depth"].shape[-1]
    places = rng.integers(0, size - CROP + 1, (BATCH, 2)).tolist()
    for prefix in ("", "next_"):
        color, depth = batch.pop(prefix + "color"), batch.pop(prefix + "depth")
        image = np.empty((BATCH, 4, CROP, CROP), np.float32)
        for row, (top, left) in enumerate(places):
            box = np.s_[top : top + CROP, left : left + CROP]
            np.divide(color[row][:, *box], np.float32(255), out=image[row, :3])
            np.multiply(depth[row][box], np.float32(scale), out=image[row, 3])
        batch[prefix + "image"] = image
    return batch


def loaded(make: Callable[[], object]) -> tuple[float, float, float, float]:
    """Fill a buffer in this process, and measure time and memory.

    Args:
        make: Function that returns a filled buffer.

    Returns:
        Wall seconds, CPU seconds, the size of the buffer's arrays [bytes], and the growth of the process [bytes].
    """
    before, wall, cpu = resident(), time.perf_counter(), time.process_time()
    buffer = make()
    taken = time.perf_counter() - wall, time.process_time() - cpu
    return *taken, buffer.nbytes, resident() - before


def in_child(function: Callable[[], tuple[float, ...]]) -> tuple[float, ...]:
    """Return the result of a function that runs in a forked process, so that it leaves nothing behind in this one."""
    here, there = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=lambda: there.send(function()))
    child.start()
    there.close()
    said = here.recv()
    child.join()
    return said


def resident() -> int:
    """Return the resident memory of this process, [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def alternating(ways: dict[str, Draw], rounds: int, draws: int = 40) -> dict[str, tuple[list[float], list[float]]]:
    """Return the CPU and wall milliseconds of each batch of each way.

    Args:
        ways: Functions that draw a batch, by name.
        rounds: Number of rounds in which every way is timed.
        draws: Number of batches that a way draws in a round.
    """
    times = {name: ([], []) for name in ways}
    for round_ in range(rounds + 1):
        for name, draw in ways.items():
            for _ in range(draws):
                wall, cpu = time.perf_counter(), time.process_time()
                draw()
                taken = time.process_time() - cpu, time.perf_counter() - wall
                if round_:  # the first one warms up
                    for kept, seconds in zip(times[name], taken, strict=True):
                        kept.append(1e3 * seconds)
    return times


def megabytes(size: float) -> str:
    """Return a size in bytes as text in megabytes."""
    return f"{size / 1e6:.1f}"


def commit() -> str:
    """Return the short name of the current commit, followed by ``+`` if files have been changed since."""
    git = ("git", "-C", str(Path(__file__).parent))
    name = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    return name + "+" * bool(subprocess.run([*git, "diff", "--quiet", "HEAD"]).returncode)


def cpu_name() -> str:
    """Return the name of the processor, as Linux gives it."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data/block_picking"))
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    dataset, count = Dataset.open(args.data), args.episodes
    installed = importlib.util.find_spec("tianshou") is not None
    rival = f"tianshou {importlib.metadata.version('tianshou')}" if installed else "tianshou is not installed"
    print(f"{cpu_name()}, NumPy {np.__version__}, {rival}, commit {commit()}, load {os.getloadavg()[0]:.1f}")
    print(f"`python benchmarks/replay.py {' '.join(sys.argv[1:])}`\n")

    makers: dict[str, Callable[[], Draw]] = {
        "ours": lambda: Ours(dataset, count),
        "list": lambda: PlainList(dataset, count),
    }
    if installed:
        import tianshou.data  # noqa: F401 - so that importing it is not counted as loading

        makers["tianshou"] = lambda: Tianshou(dataset, count, lean=False)
        makers["tianshou, lean"] = lambda: Tianshou(dataset, count, lean=True)
    variants = {
        "ours, n = 3": lambda: Ours(dataset, count, n_step=3),
        "ours, rotated by D4": lambda: Ours(dataset, count, rotate=True),
    }
    raw = sum(episode.arrays[path].nbytes for episode in first(dataset, count) for path in KEPT)
    steps = steps_of(dataset, count)
    print(f"{count} demonstrations of {dataset.info['task']}, {steps} transitions, {megabytes(raw)} MB recorded\n")
    print("| method | loading, s (wall) | arrays, MB | % of the recorded size | growth of the process, MB |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for name, make in makers.items():
        wall, cpu, size, growth = in_child(partial(loaded, make))
        cells = f"{cpu:.2f} ({wall:.2f})", megabytes(size), f"{100 * size / raw:.0f} %", megabytes(growth)
        print(f"| {name} | {' | '.join(cells)} |", flush=True)

    print("\n| method | batch, ms (10..90 %) | wall, ms | x ours |\n| --- | ---: | ---: | ---: |")
    times = alternating({name: make() for name, make in (makers | variants).items()}, args.rounds)
    ours = median(times["ours"][0])
    for name, (cpu, wall) in times.items():
        low, high = np.quantile(cpu, [0.1, 0.9])
        cells = f"{median(cpu):.2f} ({low:.2f}..{high:.2f})", f"{median(wall):.2f}", f"{median(cpu) / ours:.1f}"
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
