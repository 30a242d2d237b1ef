"""An episode that an agent is living through, kept stream by stream until it ends."""

from collections.abc import Mapping

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.replay.replay_spec import ReplaySpec
from svfl_data.replay.stored_episode import StoredEpisode

Observation = Mapping[str, np.ndarray]


class EpisodeBuilder:
    """What has happened since the reset.

    Args:
        spec: Of the buffer.
        window: Readings in the wrench window of an observation.
        observation: After the reset, as `ReplayBuffer.begin_episode` takes it.
        expert: Whether it is a demonstration.

    Raises:
        FieldError: If the observation does not fit.
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
        """Keep an action and what followed.

        Raises:
            FieldError: If something does not fit; nothing is kept of it then.
        """
        acted = _numbers("action", action, (5,))
        if fault := self._spec.bounds.fault(acted[None]):
            raise FieldError(f"action: {fault[1]}")
        gained = float(_numbers("reward", np.asarray(reward), ()))
        self._see(observation)
        self._actions.append(self._spec.action(acted))
        self._rewards.append(gained)

    def finish(self, terminated: bool) -> StoredEpisode:
        """The whole episode."""
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
    """How many readings at the end of a window need to be appended to those before to have it whole again.

    The fewest that do: with readings that repeat, fewer than there were, and the window is still the same.

    Args:
        before: The window before, shape (T, C), or no readings.
        now: The window now, shape (T, C).
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
