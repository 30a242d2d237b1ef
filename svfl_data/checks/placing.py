"""Is an episode what its file's name and its dataset say?"""

from collections.abc import Iterator

from svfl_data.checks.finding import Finding
from svfl_data.datasets.dataset import Dataset


def check_place(dataset: Dataset, index: int) -> Iterator[Finding]:
    """An episode is what its file's name and its dataset say."""
    reader = dataset.episode(index)
    name, meta = str(reader.extent), reader.meta
    if meta.index != index:
        words = f"the file's number is {index}, the attribute says {meta.index}"
        yield Finding(name, "index", None, "error", words)
    if meta.task not in str(dataset.info["task"]).split("+"):
        words = f"task {meta.task!r} in a dataset of {dataset.info['task']!r}"
        yield Finding(name, "task", None, "warning", words)
