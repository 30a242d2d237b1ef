"""Priorities, which decide how often each transition is drawn, and the importance weights that correct the bias.

Source: Schaul, Quan, Antonoglou, Silver, "Prioritized Experience Replay", ICLR 2016, section 3.
"""

import numpy as np

from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.sum_tree import SumTree

LEAST = 1e-6
"""Constant added to every absolute TD error, so that every transition can still be drawn."""


class Priorities:
    """Priority of each slot: (abs(TD error) + 1e-6 + bonus if expert)^alpha, or 0 where there is no transition.

    Args:
        slots: Number of slots, which is the capacity of the replay buffer.
        config: Settings of the replay buffer, of which alpha, beta, `beta_samples` and `expert_bonus` are used.

    Attributes:
        tree: Sum tree that holds the priority of each slot.
        expert: Whether each slot holds a transition of a demonstration, shape (slots,), bool.
        largest: Largest absolute TD error so far, at least 1. New transitions get a priority as if they had this error.
        drawn: Number of transitions drawn so far.
    """

    def __init__(self, slots: int, config: ReplayConfig) -> None:
        self._config = config
        self.tree = SumTree(slots)
        self.expert = np.zeros(slots, bool)
        self.largest, self.drawn = 1.0, 0

    @property
    def beta(self) -> float:
        """Current exponent of the importance weights."""
        start = self._config.beta
        return start + (1.0 - start) * min(1.0, self.drawn / self._config.beta_samples)

    def clear(self, slots: np.ndarray) -> None:
        """Set the priorities of slots to 0, because their transitions were removed.

        Args:
            slots: Slots of the removed transitions, shape (B,).
        """
        self.tree[slots] = 0.0

    def welcome(self, slots: np.ndarray, expert: bool) -> None:
        """Set the priorities of new transitions as if they had the largest error so far, so that they are drawn soon.

        Args:
            slots: Slots of the new transitions, shape (B,).
            expert: Whether the new transitions are of a demonstration.
        """
        self.expert[slots] = expert
        self.tree[slots] = self._of(self.largest, self.expert[slots])

    def update(self, slots: np.ndarray, errors: np.ndarray) -> None:
        """Set the priorities of transitions from their TD errors.

        Args:
            slots: Slots of the transitions, shape (B,).
            errors: TD errors of the transitions, shape (B,). Their signs do not matter.
        """
        if len(slots):
            self.largest = max(self.largest, float(np.abs(errors).max()))
            self.tree[slots] = self._of(np.abs(errors), self.expert[slots])

    def restore(self, slots: np.ndarray, priority: np.ndarray, drawn: int, largest: float) -> None:
        """Restore the state of saved priorities.

        Args:
            slots: Slots that hold transitions, shape (S,).
            priority: Priorities of these slots, shape (S,).
            drawn: Value of the attribute `drawn`.
            largest: Value of the attribute `largest`.

        Raises:
            ValueError: If a priority is negative or not finite, their number is wrong, or `largest` is below 1 or not
                finite.
        """
        if priority.shape != slots.shape or not (np.isfinite(priority) & (priority >= 0)).all():
            raise ValueError(f"{priority.shape} priorities of {len(slots)} transitions, or some below 0 or not finite")
        if not 1 <= largest < np.inf:
            raise ValueError(f"largest is {largest}")
        self.tree[slots], self.drawn, self.largest = priority, drawn, float(largest)

    def draw(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw slots with replacement, with probabilities proportional to their priorities.

        One slot is drawn from each of `count` equal shares of the sum of all priorities.

        Args:
            count: Number of slots to draw, B.
            rng: Random generator.

        Returns:
            Slots, shape (B,), int64; and importance weights, shape (B,), float32. An importance weight is
            (number of transitions * probability)^-beta, divided by the largest such value of the batch. The number of
            transitions and the sum of the priorities cancel in this quotient.
        """
        shares = (np.arange(count) + rng.random(count)) / count
        slots = self.tree.find(np.minimum(shares * self.tree.total, np.nextafter(self.tree.total, 0)))
        priority = self.tree[slots]
        weights = (priority.min() / priority) ** self.beta
        self.drawn += count
        return slots, weights.astype(np.float32)

    def _of(self, errors: np.ndarray | float, expert: np.ndarray) -> np.ndarray:
        return (errors + LEAST + self._config.expert_bonus * expert) ** self._config.alpha
