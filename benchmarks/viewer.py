"""Cost of showing an episode: time, memory and size of the file, for episodes of any length.

    .venv/bin/python benchmarks/viewer.py EPISODE.hdf5 ...

An hour-long episode can be made with `svfl_data.recording.writer.EpisodeWriter` and the steps of
``benchmarks/record.py``. Each episode is converted in a process of its own.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ["CI"] = "1"  # no usage statistics
os.environ.setdefault("OMP_NUM_THREADS", "1")

from svfl_data.storage.reader import EpisodeReader


def convert(file: Path) -> None:
    """Convert one episode file and print a row of the table."""
    start, cpu = time.perf_counter(), time.process_time()
    from svfl_data.viewer import show
    from svfl_data.viewer.entities.episode_source import EpisodeSource

    loading = time.perf_counter() - start
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    episode = EpisodeReader.of_file(file)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "episode.rrd"
        show.save(show.content([(EpisodeSource.of(episode), None)]), path)
        size = path.stat().st_size
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(
        f"| {len(episode)} | {episode.seconds:.1f} | {seconds:.1f} | {loading:.1f} | {cpu:.1f} | {before / 1024:.0f} "
        f"| {grown:.0f} | {file.stat().st_size / 1e6:.1f} | {size / 1e6:.1f} |",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("episodes", type=Path, nargs="+")
    parser.add_argument("--row", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.row:
        convert(arguments.episodes[0])
        return
    print("| steps | seconds | time, s | of it loading, s | CPU, s | memory before, MiB | more, MiB | episode, MB | file, MB |")  # fmt: skip  # noqa: E501
    print("|" + " --- |" * 9, flush=True)
    for episode in arguments.episodes:
        subprocess.run([sys.executable, __file__, "--row", str(episode)], check=True)


if __name__ == "__main__":
    main()
