"""Finished episodes in the order they came, of which the oldest are forgotten whole when there is no room left."""

import numpy as np

from svfl_data.errors import UsageError
from svfl_data.replay.stored_episode import StoredEpisode


class Ring:
    """Episodes whose transitions are numbered from 0 without end; number k lies in slot k modulo the capacity.

    Args:
        capacity: Transitions that there is room for.
        first: Number of the first transition that will come.

    Attributes:
        episodes: Those that are kept, oldest first.
        begin: Number of the first transition of each, shape (E,), int64.
        next: Number of the next transition that will come.
    """

    def __init__(self, capacity: int, first: int = 0) -> None:
        self.capacity, self.next = capacity, first
        self.episodes: list[StoredEpisode] = []
        self.begin = np.empty(0, np.int64)

    @property
    def first(self) -> int:
        """Number of the oldest transition that is kept."""
        return int(self.begin[0]) if self.episodes else self.next

    def __len__(self) -> int:
        return self.next - self.first

    def append(self, episode: StoredEpisode) -> tuple[np.ndarray, np.ndarray]:
        """Keep an episode.

        Returns:
            Slots that became free, and slots that were taken after that.

        Raises:
            UsageError: If the episode alone is longer than the capacity.
        """
        if len(episode) > self.capacity:
            raise UsageError(f"an episode of {len(episode)} steps does not fit into a capacity of {self.capacity}")
        oldest = self.first
        while self.episodes and len(self) + len(episode) > self.capacity:
            self.episodes.pop(0)
            self.begin = self.begin[1:]
        kept = self.first
        self.episodes.append(episode)
        self.begin = np.append(self.begin, self.next)
        self.next += len(episode)
        return np.arange(oldest, kept) % self.capacity, np.arange(self.next - len(episode), self.next) % self.capacity

    def locate(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What lies in slots that are taken, shape (B,): number, position of its episode, step in the episode."""
        newest = self.next - 1
        numbers = newest - (newest - slots) % self.capacity
        positions = np.searchsorted(self.begin, numbers, side="right") - 1
        return numbers, positions, numbers - self.begin[positions]
