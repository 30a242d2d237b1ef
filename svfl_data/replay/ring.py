"""Finished episodes in the order of their arrival; the oldest ones are removed as a whole when there is no room."""

import numpy as np

from svfl_data.errors import UsageError
from svfl_data.replay.stored_episode import StoredEpisode


class Ring:
    """Ring of episodes whose transitions have consecutive numbers; transition k is in slot k modulo the capacity.

    Args:
        capacity: Largest number of transitions.
        first: Number of the first transition that will be added.

    Attributes:
        capacity: Largest number of transitions.
        episodes: Episodes that are kept, oldest first.
        begin: Number of the first transition of each kept episode, shape (E,), int64.
        next: Number of the next transition that will be added.
    """

    def __init__(self, capacity: int, first: int = 0) -> None:
        self.capacity, self.next = capacity, first
        self.episodes: list[StoredEpisode] = []
        self.begin = np.empty(0, np.int64)

    @property
    def first(self) -> int:
        """Number of the oldest transition that is kept; `next` if there is none."""
        return int(self.begin[0]) if self.episodes else self.next

    def __len__(self) -> int:
        return self.next - self.first

    def append(self, episode: StoredEpisode) -> tuple[np.ndarray, np.ndarray]:
        """Add an episode, and remove the oldest episodes for which there is no room.

        Args:
            episode: Episode to add.

        Returns:
            Slots of the removed transitions, and slots of the added transitions. The two may overlap.

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
        """Find the transitions in slots.

        Args:
            slots: Slots that hold transitions, shape (B,).

        Returns:
            For each slot the number of the transition, the position of its episode in `episodes`, and its step in the
            episode, each of shape (B,), int64.
        """
        newest = self.next - 1
        numbers = newest - (newest - slots) % self.capacity
        positions = np.searchsorted(self.begin, numbers, side="right") - 1
        return numbers, positions, numbers - self.begin[positions]
