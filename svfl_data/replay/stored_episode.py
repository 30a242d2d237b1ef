"""A finished episode of a replay buffer: each stream is stored once; windows and returns are computed on request."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.replay.specs.layout import REWARD, Layout
from svfl_data.schema.episode import Episode


@dataclass(frozen=True, eq=False)
class StoredEpisode:
    """Finished episode with N actions and N + 1 observations.

    Attributes:
        arrays: Arrays by the names of a `Layout`: rows of streams and the number of rows up to each observation, rows
            of vectors (N+1, ...), actions (N, C), and the reward of each action (N,).
        terminated: Whether the last action led to a final state of the task. If not, the episode was truncated, and
            the last observation still has a value.
        expert: Whether the episode is a demonstration.
    """

    arrays: Mapping[str, np.ndarray]
    terminated: bool
    expert: bool

    def __len__(self) -> int:
        return len(self.arrays[REWARD])

    def require_fit(self, layout: Layout) -> None:
        """Refuse arrays that do not fit each other or a layout.

        Args:
            layout: Layout of the replay buffer.

        Raises:
            ValueError: If an array has a wrong shape or type, the episode has no steps, or a number of rows is out of
                range.
        """
        for fault in layout.faults(self.arrays):
            raise ValueError(fault)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays of the episode take, [bytes]."""
        return sum(array.nbytes for array in self.arrays.values())

    def window(self, name: str, end: int, length: int) -> np.ndarray:
        """Return the last rows of an array up to an observation, shape (T, ...), latest last.

        Where there was no row yet, the first row is repeated; all rows are zero if there was none at all.

        Args:
            name: Name of the array.
            end: Number of rows up to the observation.
            length: Number of rows, T.
        """
        array = self.arrays[name]
        rows = array[max(0, end - length) : end]
        if len(rows) == length:
            return rows
        filler = rows[:1] if len(rows) else np.zeros((1, *array.shape[1:]), array.dtype)
        return np.concatenate([np.repeat(filler, length - len(rows), axis=0), rows])

    def outcome(self, step: int, powers: np.ndarray) -> tuple[int, float, float]:
        """Return the outcome of an action after n steps, or at the end of the episode if it ends before.

        Args:
            step: Number of the action, 0 to N - 1.
            powers: Powers 1, gamma, .., gamma^n of the discount factor, shape (n+1,), float64.

        Returns:
            Number of the observation s' that was reached after m steps, the discounted sum of the rewards up to s', and
            the discount of the value of s': gamma^m, or 0 if the task ended at s'.
        """
        rewards = self.arrays[REWARD][step : step + len(powers) - 1]
        later = step + len(rewards)
        final = self.terminated and later == len(self)
        return later, float(powers[: len(rewards)] @ rewards), 0.0 if final else float(powers[len(rewards)])


def sparse_reward(episode: Episode) -> np.ndarray:
    """Return the reward of each action of a recorded episode, shape (N,), float32.

    The last action, which achieved the task, has the reward 1, all before have 0. An episode without success has no
    reward and counts as truncated, because the recording was stopped.

    Args:
        episode: Recorded episode.

    Raises:
        DatasetError: If the episode has no actions.
    """
    if not len(episode):
        raise DatasetError(f"{episode.name}: has no actions, so no transitions")
    reward = np.zeros(len(episode), np.float32)
    reward[-1] = episode.meta.success
    return reward
