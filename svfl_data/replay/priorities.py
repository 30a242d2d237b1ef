"""How often each transition is drawn, and the weight that makes up for it.

Source: Schaul, Quan, Antonoglou, Silver, "Prioritized Experience Replay", ICLR 2016, section 3.
"""

import numpy as np

from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.sum_tree import SumTree

LEAST = 1e-6
"""Error that everything counts for at least, so that nothing is forgotten for ever."""


class Priorities:
    """A priority for each slot: (abs(TD error) + 1e-6 + bonus if expert)^alpha, 0 where there is no transition.

    Args:
        slots: How many slots.
        config: Powers and bonus.

    Attributes:
        expert: Which slots hold demonstrations, shape (slots,), bool.
        largest: Largest error met so far, 1 before any; what has just come counts as if it had that one.
        drawn: Transitions drawn so far.
    """

    def __init__(self, slots: int, config: ReplayConfig) -> None:
        self._config = config
        self.tree = SumTree(slots)
        self.expert = np.zeros(slots, bool)
        self.largest, self.drawn = 1.0, 0

    @property
    def beta(self) -> float:
        """Power of the importance weights now."""
        start = self._config.beta
        return start + (1.0 - start) * min(1.0, self.drawn / self._config.beta_samples)

    def clear(self, slots: np.ndarray) -> None:
        """Forget what was there."""
        self.tree[slots] = 0.0

    def welcome(self, slots: np.ndarray, expert: bool) -> None:
        """Let transitions in, with the largest error so far, so that they will be looked at soon."""
        self.expert[slots] = expert
        self.tree[slots] = self._of(self.largest, self.expert[slots])

    def update(self, slots: np.ndarray, errors: np.ndarray) -> None:
        """Set the errors of transitions, shape (B,); signs do not matter."""
        if len(slots):
            self.largest = max(self.largest, float(np.abs(errors).max()))
            self.tree[slots] = self._of(np.abs(errors), self.expert[slots])

    def restore(self, slots: np.ndarray, priority: np.ndarray, drawn: int, largest: float) -> None:
        """Go on where others were.

        Args:
            slots: Those that are taken, shape (S,).
            priority: Their priorities, shape (S,).
            drawn: As the attribute.
            largest: As the attribute.

        Raises:
            ValueError: If priorities cannot have been these.
        """
        if priority.shape != slots.shape or not (np.isfinite(priority) & (priority >= 0)).all():
            raise ValueError(f"{priority.shape} priorities of {len(slots)} transitions, or some below 0 or not finite")
        if not 1 <= largest < np.inf:
            raise ValueError(f"largest is {largest}")
        self.tree[slots], self.drawn, self.largest = priority, drawn, float(largest)

    def draw(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw slots in proportion to their priorities, with replacement, one from each of `count` equal shares.

        Args:
            count: How many, B.
            rng: Source of chance.

        Returns:
            Slots, shape (B,), int64, and importance weights (size times probability)^-beta divided by the largest of
            the batch, shape (B,), float32. Size and sum of the priorities cancel in that quotient.
        """
        shares = (np.arange(count) + rng.random(count)) / count
        slots = self.tree.find(np.minimum(shares * self.tree.total, np.nextafter(self.tree.total, 0)))
        priority = self.tree[slots]
        weights = (priority.min() / priority) ** self.beta
        self.drawn += count
        return slots, weights.astype(np.float32)

    def _of(self, errors: np.ndarray | float, expert: np.ndarray) -> np.ndarray:
        return (errors + LEAST + self._config.expert_bonus * expert) ** self._config.alpha
