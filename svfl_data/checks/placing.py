"""Check that an episode agrees with the name of its file and with its dataset."""

from collections.abc import Iterator

from svfl_data.checks.finding import Finding
from svfl_data.datasets.dataset import Dataset


def check_place(dataset: Dataset, index: int) -> Iterator[Finding]:
    """Check that index and task of an episode are those of its file's name and of its dataset.

    Args:
        dataset: Dataset to which the episode belongs.
        index: Index of the episode, as the name of its file gives it.
    """
    reader = dataset.episode(index)
    name, meta = str(reader.extent), reader.meta
    if meta.index != index:
        words = f"the file's number is {index}, the attribute says {meta.index}"
        yield Finding(name, "index", None, "error", words)
    if meta.task not in str(dataset.info["task"]).split("+"):
        words = f"task {meta.task!r} in a dataset of {dataset.info['task']!r}"
        yield Finding(name, "task", None, "warning", words)
