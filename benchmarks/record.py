"""Cost of recording: time per step, and memory for an hour-long episode.

    .venv/bin/python benchmarks/record.py --minutes 1 60
    .venv/bin/python benchmarks/record.py --minutes 0.25 --size 480 640

A step at 20 Hz has 25 wrench readings at 500 Hz, joints, one observation, one action and one RGB-D frame. Steps are
appended as fast as possible, so an hour of readings arrives in minutes. This is a harder load for memory than a real
hour, since the journal is flushed by volume instead of by the clock. Each length runs in a process of its own, and its
memory is compared with that of the same process before the first step.
"""

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.episode import Meta

STEPS_PER_MINUTE = 20 * 60
READINGS = 25  # wrench readings per step: 500 Hz
STEP_NS = 50_000_000


def constants() -> dict[str, np.ndarray]:
    """Return the calibration arrays that an episode must have, by dataset path."""
    return {
        "workspace": np.array([[0.35, 0.75], [-0.2, 0.2], [-0.01, 0.25]]),
        "streams/wrench/tare": np.zeros(6),
        "cameras/front/intrinsics": np.eye(3),
        "cameras/front/T_base_camera": np.eye(4),
        "cameras/front/image_axes": np.eye(2),
        "cameras/front/depth_scale": np.array(1e-4),
    }


def frames(rng: np.random.Generator, size: tuple[int, int], noise: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return ten RGB-D images, either pure noise or smooth with the noise of a real camera in the lowest bits.

    Args:
        rng: Generator that the noise is drawn from.
        size: Height and width of the images, [px].
        noise: Whether the images are pure noise.

    Returns:
        Colour images, (10, H, W, 3) uint8, and depth images, (10, H, W) uint16.
    """
    if noise:
        return rng.integers(0, 256, (10, *size, 3), np.uint8), rng.integers(0, 2**16, (10, *size), np.uint16)
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / size[0]
    shade = 120 + 80 * np.sin(5 * x) * np.cos(4 * y)
    color = shade[None, :, :, None] + rng.normal(0, 1.5, (10, *size, 3))
    depth = 8000 + 2000 * y + rng.normal(0, 4, (10, *size))
    return color.astype(np.uint8), depth.astype(np.uint16)


def record(folder: Path, minutes: float, size: tuple[int, int], noise: bool) -> None:
    """Record one episode and print a row of the table.

    Args:
        folder: Folder of the dataset to record into.
        minutes: Length of the episode, [min].
        size: Height and width of the images, [px].
        noise: Whether the images are pure noise.
    """
    rng = np.random.default_rng(0)
    color, depth = frames(rng, size, noise)
    wrench = rng.normal(0, 1, (READINGS, 6)).astype(np.float32)
    spread = np.arange(READINGS) * (STEP_NS // READINGS)
    dataset = Dataset.create_or_resume(folder, "pushing", 0, {})
    steps = round(minutes * STEPS_PER_MINUTE)
    row = np.zeros((1, 5), np.float32)
    joints = np.zeros((1, 9), np.float32)
    times = np.empty(steps)
    before = memory_mb()
    cpu = time.process_time()
    with EpisodeWriter(dataset, Meta("pushing", NEXT, 0, "robot", True), constants()) as writer:
        for step in range(steps):
            start = time.perf_counter()
            now = np.array([step * STEP_NS])
            frame = slice(step % 10, step % 10 + 1)
            writer.append("streams/wrench", t_ns=now + spread, wrench=wrench)
            writer.append("streams/joints", t_ns=now, position=joints)
            writer.append("cameras/front", t_ns=now, color=color[frame], depth=depth[frame])
            writer.append("observations", t_ns=now, proprio=row)
            writer.append("actions", action=row)
            times[step] = time.perf_counter() - start
        writer.append("observations", t_ns=np.array([steps * STEP_NS]), proprio=row)
        writer.flush()
        cpu = time.process_time() - cpu
        recorded = memory_mb()
        journal = writer._journal.path.stat().st_size
        sealing = time.process_time()
        path = writer.seal()
        sealing = time.process_time() - sealing
    times *= 1000
    print(
        f"| {minutes:g} | {'noise' if noise else 'smooth'} | {times.mean():.3f} | {1000 * cpu / steps:.3f} "
        f"| {np.percentile(times, 99):.2f} | {times.max():.0f} | {recorded - before:.0f} | {memory_mb() - before:.0f} "
        f"| {journal / 2**20:.0f} | {path.stat().st_size / 2**20:.0f} | {sealing:.1f} "
        f"| {sealing / (60 * minutes):.3f} |",
        flush=True,
    )


def memory_mb() -> float:
    """Return the largest resident memory of this process so far, [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, nargs="+", default=[1, 10, 60])
    parser.add_argument("--size", type=int, nargs=2, default=[76, 76], help="rows and columns of an image")
    parser.add_argument("--noise", action="store_true", help="images that cannot be compressed")
    parser.add_argument("--row", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.row:
        with tempfile.TemporaryDirectory() as folder:
            record(Path(folder) / "recorded", arguments.minutes[0], tuple(arguments.size), arguments.noise)
        return
    print(f"{platform.processor() or platform.machine()}, RGB-D {' x '.join(map(str, arguments.size))}\n")
    print("| minutes | images | ms per step | ms CPU per step | 99 %, ms | longest, ms | memory recording, MiB "
          "| memory sealing, MiB | journal, MiB | file, MiB | sealing, s CPU | of a recorded second, s |")  # fmt: skip
    print("|" + " --- |" * 12, flush=True)
    for minutes in arguments.minutes:
        command = [sys.executable, __file__, "--row", "--minutes", str(minutes), "--size", *map(str, arguments.size)]
        subprocess.run(command + ["--noise"] * arguments.noise, check=True)


if __name__ == "__main__":
    main()
