"""One finished episode as a replay buffer keeps it: every stream once, windows and returns made when asked for."""

from dataclasses import dataclass

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.replay.replay_spec import ReplaySpec
from svfl_data.schema.episode import Camera, Episode

ARRAYS = ("color", "depth", "wrench", "wrench_end", "proprio", "action", "reward")
"""The arrays of an episode, by name."""


@dataclass(frozen=True, eq=False)
class StoredEpisode:
    """N actions, N + 1 observations, M wrench readings; vectors in image-aligned axes, positions from the centre.

    Attributes:
        color: (N+1, 3, H, W) uint8.
        depth: (N+1, H, W) uint16, 0 where nothing was measured.
        wrench: (M, 6) float32, tared, [N] and [N m].
        wrench_end: Readings that there were at each observation, (N+1,) int64.
        proprio: (N+1, 5) float32.
        action: (N, 5) float32.
        reward: Of each action, (N,) float32.
        terminated: Whether the last action led to a final state of the task; if not, the episode was cut off
            (truncated), and what would have followed is worth something.
        expert: Whether it is a demonstration.
    """

    color: np.ndarray
    depth: np.ndarray
    wrench: np.ndarray
    wrench_end: np.ndarray
    proprio: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    terminated: bool
    expert: bool

    @classmethod
    def of_episode(cls, episode: Episode, camera: Camera, spec: ReplaySpec) -> "StoredEpisode":
        """A demonstration from a file.

        Its reward is sparse: 1 for the action that achieved the task, with which the episode ends, 0 before. A
        recording without success ended because nobody went on acting: it is truncated.

        Args:
            episode: As recorded, fit for training (`svfl_data.checks.check_usable`).
            camera: Whose images to keep.
            spec: Of the episode and the camera.

        Raises:
            DatasetError: If it has no actions, or there is an observation before any frame.
        """
        if not len(episode):
            raise DatasetError(f"{episode.name}: has no actions, so no transitions")
        frames = np.searchsorted(camera.t_ns, episode.t_ns, side="right") - 1
        if (frames < 0).any():
            raise DatasetError(f"{episode.name}: camera {camera.name} had no frame yet at the first observation")
        reward = np.zeros(len(episode), np.float32)
        reward[-1] = episode.meta.success
        return cls(
            color=np.ascontiguousarray(camera.color[frames].transpose(0, 3, 1, 2)),  # (N+1, H, W, 3) -> (N+1, 3, H, W)
            depth=camera.depth[frames],
            wrench=spec.wrench(episode.tared_wrench),
            wrench_end=np.searchsorted(episode.wrench_t_ns, episode.t_ns, side="right"),
            proprio=spec.proprio(episode.proprio),
            action=spec.action(episode.action),
            reward=reward,
            terminated=episode.meta.success,
            expert=True,
        )

    def __len__(self) -> int:
        return len(self.action)

    def require_fit(self, spec: ReplaySpec) -> None:
        """Refuse arrays that do not belong together, or not to a spec.

        Raises:
            ValueError: If one has another shape or type.
        """
        steps, readings = len(self.action), len(self.wrench)
        expected = {
            "color": ((steps + 1, 3, *spec.size), "u1"), "depth": ((steps + 1, *spec.size), "u2"),
            "wrench": ((readings, 6), "f4"), "wrench_end": ((steps + 1,), "i8"), "proprio": ((steps + 1, 5), "f4"),
            "action": ((steps, 5), "f4"), "reward": ((steps,), "f4"),
        }  # fmt: skip
        for name, array in self.arrays.items():
            if (array.shape, array.dtype) != (expected[name][0], np.dtype(expected[name][1])):
                raise ValueError(f"{name} is {array.dtype} {array.shape}, expected {expected[name]}")
        if not steps or ((self.wrench_end < 0) | (self.wrench_end > readings)).any():
            raise ValueError(f"{steps} steps, or readings beyond the {readings} that there are")

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Its arrays, by name."""
        return {name: getattr(self, name) for name in ARRAYS}

    @property
    def nbytes(self) -> int:
        """Memory that it takes, [bytes]."""
        return sum(array.nbytes for array in self.arrays.values())

    def window(self, step: int, length: int) -> np.ndarray:
        """The last readings at an observation, shape (T, 6), latest last.

        Where there was no reading yet the first one is repeated; zeros if there was none at all.
        """
        end = int(self.wrench_end[step])
        readings = self.wrench[max(0, end - length) : end]
        if len(readings) == length:
            return readings
        filler = readings[:1] if len(readings) else np.zeros((1, 6), np.float32)
        return np.concatenate([np.repeat(filler, length - len(readings), axis=0), readings])

    def outcome(self, step: int, powers: np.ndarray) -> tuple[int, float, float]:
        """What followed an action within n steps.

        Args:
            step: Of the action.
            powers: 1, gamma, .., gamma^n, shape (n+1,), float64.

        Returns:
            The observation s' up to which was looked, the discounted sum of the rewards on the way, and the discount of
            the value of s': gamma^m after m steps, 0 if the task had ended there.
        """
        rewards = self.reward[step : step + len(powers) - 1]
        later = step + len(rewards)
        final = self.terminated and later == len(self)
        return later, float(powers[: len(rewards)] @ rewards), 0.0 if final else float(powers[len(rewards)])
