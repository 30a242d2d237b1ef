"""Benefit of more workers: wall time of the same demonstrations by one and two processes, and memory of each worker.

    .venv/bin/python benchmarks/workers.py --task block_picking --episodes 200

The start-up of the processes is in the time of the whole command; the rate is counted from the first file to the last.
The runs alternate, so that other load on the machine affects both.
"""

import argparse
import contextlib
import os
import platform
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import psutil


def collect(task: str, episodes: int, workers: int, out: Path) -> tuple[float, float, float]:
    """Collect a dataset with the command-line program.

    Args:
        task: Name of the task.
        episodes: Number of episodes.
        workers: Number of worker processes.
        out: Folder of the dataset.

    Returns:
        Wall seconds, episodes per second, and the largest memory of a worker, [MiB].
    """
    command = [sys.executable, "-c", "from collectors.cli import main; raise SystemExit(main())"]
    command += ["expert", "--task", task, "--episodes", str(episodes), "--workers", str(workers), "--out", str(out)]
    start = time.perf_counter()
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak = [0]

    def watch() -> None:
        while running.poll() is None:
            with contextlib.suppress(psutil.NoSuchProcess):  # it has just ended
                children = psutil.Process(running.pid).children(recursive=True)
                peak[0] = max([peak[0], *(child.memory_info().rss for child in children)])
            time.sleep(0.1)

    watcher = threading.Thread(target=watch)
    watcher.start()
    if running.wait():
        raise SystemExit(f"{' '.join(command[3:])} failed")
    seconds = time.perf_counter() - start
    watcher.join()
    written = [file.stat().st_mtime for file in out.glob("*.hdf5")]
    return seconds, (len(written) - 1) / (max(written) - min(written)), peak[0] / 2**20


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="block_picking")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=2)
    asked = parser.parse_args()
    machine = platform.processor() or platform.machine()
    print(f"{machine}, {asked.task}, {asked.episodes} episodes, load {os.getloadavg()[0]:.1f} before\n")
    print("| round | one worker, s | two workers, s | ratio | ratio of rates | memory of a worker, MiB |")
    print("| --- " * 6 + "|")
    for number in range(asked.rounds):
        with tempfile.TemporaryDirectory() as folder:
            one, slow, memory = collect(asked.task, asked.episodes, 1, Path(folder) / "one")
            two, fast, other = collect(asked.task, asked.episodes, 2, Path(folder) / "two")
        ratios = f"{one / two:.2f} | {fast / slow:.2f}"
        print(f"| {number + 1} | {one:.1f} | {two:.1f} | {ratios} | {max(memory, other):.0f} |", flush=True)


if __name__ == "__main__":
    main()
