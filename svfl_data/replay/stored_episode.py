"""A finished episode of a replay buffer: each stream is stored once; windows and returns are computed on request."""

from dataclasses import dataclass

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.replay.replay_spec import ReplaySpec
from svfl_data.schema.episode import Camera, Episode

ARRAYS = ("color", "depth", "wrench", "wrench_end", "proprio", "action", "reward")
"""Names of the arrays of a `StoredEpisode`."""


@dataclass(frozen=True, eq=False)
class StoredEpisode:
    """Finished episode with N actions, N + 1 observations and M wrench readings.

    All vectors are in image-aligned axes, and positions are relative to the workspace centre.

    Attributes:
        color: Colour image at each observation, shape (N+1, 3, H, W), uint8.
        depth: Depth image at each observation, shape (N+1, H, W), uint16, in units of `ReplaySpec.depth_scale`; 0 where
            nothing was measured.
        wrench: Tared wrench readings, shape (M, 6), float32, [N] and [N m].
        wrench_end: Number of wrench readings up to each observation, shape (N+1,), int64.
        proprio: Proprioception at each observation, shape (N+1, 5), float32.
        action: Commanded actions, shape (N, 5), float32.
        reward: Reward of each action, shape (N,), float32.
        terminated: Whether the last action led to a final state of the task. If not, the episode was truncated, and
            the last observation still has a value.
        expert: Whether the episode is a demonstration.
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
        """Convert a recorded episode into a demonstration.

        The reward is sparse: 1 for the last action, which achieved the task, and 0 for all actions before. An episode
        without success has no reward and counts as truncated, because the recording was stopped.

        Args:
            episode: Recorded episode that is fit for training (`svfl_data.checks.check_usable`).
            camera: Camera of the episode whose images are kept.
            spec: Spec of the episode and the camera.

        Raises:
            DatasetError: If the episode has no actions, or the camera has no frame at or before the first observation.
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
        """Refuse arrays that do not fit each other or a spec.

        Args:
            spec: Spec that the size of the images must match.

        Raises:
            ValueError: If an array has a wrong shape or type, the episode has no steps, or `wrench_end` is out of
                range.
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
        """Arrays of the episode by their names (`ARRAYS`)."""
        return {name: getattr(self, name) for name in ARRAYS}

    @property
    def nbytes(self) -> int:
        """Memory that the arrays of the episode take, [bytes]."""
        return sum(array.nbytes for array in self.arrays.values())

    def window(self, step: int, length: int) -> np.ndarray:
        """Return the last wrench readings up to an observation, shape (T, 6), latest last.

        Where there was no reading yet, the first reading is repeated; all readings are zero if there was none at all.

        Args:
            step: Number of the observation, 0 to N.
            length: Number of readings, T.
        """
        end = int(self.wrench_end[step])
        readings = self.wrench[max(0, end - length) : end]
        if len(readings) == length:
            return readings
        filler = readings[:1] if len(readings) else np.zeros((1, 6), np.float32)
        return np.concatenate([np.repeat(filler, length - len(readings), axis=0), readings])

    def outcome(self, step: int, powers: np.ndarray) -> tuple[int, float, float]:
        """Return the outcome of an action after n steps, or at the end of the episode if it ends before.

        Args:
            step: Number of the action, 0 to N - 1.
            powers: Powers 1, gamma, .., gamma^n of the discount factor, shape (n+1,), float64.

        Returns:
            Number of the observation s' that was reached after m steps, the discounted sum of the rewards up to s', and
            the discount of the value of s': gamma^m, or 0 if the task ended at s'.
        """
        rewards = self.reward[step : step + len(powers) - 1]
        later = step + len(rewards)
        final = self.terminated and later == len(self)
        return later, float(powers[: len(rewards)] @ rewards), 0.0 if final else float(powers[len(rewards)])
