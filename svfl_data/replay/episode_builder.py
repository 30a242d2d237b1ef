"""The current episode of an agent, stored stream by stream until the episode ends."""

from collections.abc import Mapping

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.replay.replay_spec import ReplaySpec
from svfl_data.replay.stored_episode import StoredEpisode

Observation = Mapping[str, np.ndarray]


class EpisodeBuilder:
    """Observations, actions and rewards of an episode since the reset.

    Args:
        spec: Spec of the replay buffer.
        window: Number of readings in the wrench window of an observation.
        observation: Observation after the reset, as for `ReplayBuffer.begin_episode`.
        expert: Whether the episode is a demonstration.

    Raises:
        FieldError: If an array of the observation is missing or has a wrong shape or value.
    """

    def __init__(self, spec: ReplaySpec, window: int, observation: Observation, expert: bool) -> None:
        self._spec, self._window, self._expert = spec, window, expert
        self._color: list[np.ndarray] = []
        self._depth: list[np.ndarray] = []
        self._proprio: list[np.ndarray] = []
        self._readings: list[np.ndarray] = []
        self._end: list[int] = []
        self._actions: list[np.ndarray] = []
        self._rewards: list[float] = []
        self._felt = np.empty((0, 6))
        self._see(observation)

    def __len__(self) -> int:
        return len(self._actions)

    def add(self, action: np.ndarray, observation: Observation, reward: float) -> None:
        """Add an action, the observation after the action, and the reward of the action.

        Args:
            action: Commanded action, shape (5,), base axes.
            observation: Observation after the action, as for `ReplayBuffer.begin_episode`.
            reward: Reward of the action.

        Raises:
            FieldError: If the action, the observation or the reward has a wrong shape or value. The step is then not
                added.
        """
        acted = _numbers("action", action, (5,))
        if fault := self._spec.bounds.fault(acted[None]):
            raise FieldError(f"action: {fault[1]}")
        gained = float(_numbers("reward", np.asarray(reward), ()))
        self._see(observation)
        self._actions.append(self._spec.action(acted))
        self._rewards.append(gained)

    def finish(self, terminated: bool) -> StoredEpisode:
        """Return the whole episode.

        Args:
            terminated: Whether the task ended with the last action; if not, the episode was truncated.
        """
        return StoredEpisode(
            color=np.stack(self._color),
            depth=np.stack(self._depth),
            wrench=np.concatenate(self._readings),
            wrench_end=np.array(self._end, np.int64),
            proprio=np.stack(self._proprio),
            action=np.stack(self._actions),
            reward=np.array(self._rewards, np.float32),
            terminated=terminated,
            expert=self._expert,
        )

    def _see(self, observation: Observation) -> None:
        for name in ("image", "wrench", "proprio"):
            if name not in observation:
                raise FieldError(f"observation: {name} is missing; it has {', '.join(observation) or 'nothing'}")
        image = _numbers("image", observation["image"], (4, *self._spec.size))
        felt = _numbers("wrench", observation["wrench"], (self._window, 6))
        proprio = _numbers("proprio", observation["proprio"], (5,))
        color, depth = self._spec.pixels(image)
        new = felt[len(felt) - unseen(self._felt, felt) :]
        self._felt = felt
        self._color.append(color)
        self._depth.append(depth)
        self._proprio.append(self._spec.proprio(proprio))
        self._readings.append(self._spec.wrench(new))
        self._end.append((self._end[-1] if self._end else 0) + len(new))


def unseen(before: np.ndarray, now: np.ndarray) -> int:
    """Count the readings at the end of a window that are not in the previous window.

    The count is the smallest number of readings that, appended to the previous window, give the current one. If
    readings repeat, it can be smaller than the number of new readings, but the window is still the same.

    Args:
        before: Previous window, shape (T, C), or no readings, shape (0, C).
        now: Current window, shape (T, C).
    """
    if not len(before):
        return len(now)
    for new in np.flatnonzero((before == now[0]).all(axis=1)).tolist():
        if np.array_equal(before[new:], now[: len(now) - new]):
            return int(new)
    return len(now)


def _numbers(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    found = np.asarray(values)
    if found.shape != shape:
        raise FieldError(f"{name} has shape {found.shape}, expected {shape}")
    if found.dtype.kind not in "fiub" or not np.isfinite(found).all():
        raise FieldError(f"{name} ({found.dtype}) holds something that is not a finite number")
    return np.array(found)  # a copy: environments may use their arrays again
