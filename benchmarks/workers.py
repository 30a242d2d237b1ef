"""What more workers give: wall time of the same demonstrations by one and two processes, and the memory of each worker.

    .venv/bin/python benchmarks/workers.py --task block_picking --episodes 200

Start-up of the processes is in the time. Runs alternate, so that other load on the machine meets both.
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


def collect(task: str, episodes: int, workers: int, out: Path) -> tuple[float, float]:
    """Collect by the command; returns wall seconds and the largest memory of a worker, [MiB]."""
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
    return seconds, peak[0] / 2**20


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="block_picking")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=2)
    asked = parser.parse_args()
    load = os.getloadavg()[0]
    print(
        f"{platform.processor() or platform.machine()}, {asked.task}, {asked.episodes} episodes, load {load:.1f} before"
    )
    print(
        "| round | one worker, s | two workers, s | ratio | memory of a worker, MiB |\n| --- | --- | --- | --- | --- |"
    )
    for number in range(asked.rounds):
        with tempfile.TemporaryDirectory() as folder:
            one, memory = collect(asked.task, asked.episodes, 1, Path(folder) / "one")
            two, memory_two = collect(asked.task, asked.episodes, 2, Path(folder) / "two")
        print(f"| {number + 1} | {one:.1f} | {two:.1f} | {one / two:.2f} | {max(memory, memory_two):.0f} |", flush=True)


if __name__ == "__main__":
    main()
