"""Sinks that take the rows of an episode while it is recorded: memory, or the writer of an episode's file."""

from collections import defaultdict
from typing import Any, Protocol

import numpy as np


class Sink(Protocol):
    """Object that takes rows. `Memory` is one, and `svfl_data.recording.writer.EpisodeWriter` is another."""

    def append(self, group: str, **columns: Any) -> object:  # noqa: ANN401 - a writer has further options
        """Append rows to a group.

        Args:
            group: Group of arrays with equal numbers of rows, such as ``streams/wrench``.
            columns: Rows of each array by name, shape (M, ...).
        """


class Memory:
    """Sink that keeps the rows in memory."""

    def __init__(self) -> None:
        self._rows: defaultdict[str, list[np.ndarray]] = defaultdict(list)

    def append(self, group: str, **columns: np.ndarray) -> None:
        """Append rows to a group; they are not copied.

        Args:
            group: Group of arrays with equal numbers of rows, such as ``streams/wrench``.
            columns: Rows of each array by name, shape (M, ...).
        """
        for name, values in columns.items():
            self._rows[f"{group}/{name}"].append(values)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays so far by dataset path."""
        return {path: np.concatenate(rows) for path, rows in self._rows.items()}
