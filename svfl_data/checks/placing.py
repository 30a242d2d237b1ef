"""Is an episode what its file's name and its dataset say, and like the others?"""

from collections.abc import Iterator
from pathlib import Path

from svfl_data.checks.finding import Finding
from svfl_data.dataset import Dataset
from svfl_data.episode import Episode


def check_place(dataset: Dataset, index: int) -> Iterator[Finding]:
    """An episode is what its file's name and its dataset say."""
    reader = dataset.episode(index)
    name, meta = str(reader.extent), reader.meta
    if meta.index != index:
        words = f"the file's number is {index}, the attribute says {meta.index}"
        yield Finding(name, "index", None, "error", words)
    if meta.task not in str(dataset.info.get("task")).split("+"):
        words = f"task {meta.task!r} in a dataset of {dataset.info.get('task')!r}"
        yield Finding(name, "task", None, "warning", words)


def check_alike(first: Episode, episode: Episode) -> Iterator[Finding]:
    """Episodes of a dataset have the same streams and the same image sizes."""
    for path in sorted(first.arrays.keys() ^ episode.arrays.keys()):
        words = f"{'missing' if path in first.arrays else 'extra'}, compared with {Path(first.name).name}"
        yield Finding(episode.name, path, None, "warning", words)
    for path in first.arrays.keys() & episode.arrays.keys():
        here, there = episode.arrays[path].shape[1:], first.arrays[path].shape[1:]
        if path.startswith("cameras/") and here != there:
            words = f"size {here}, but {there} in {Path(first.name).name}"
            yield Finding(episode.name, path, None, "warning", words)
