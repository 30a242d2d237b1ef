"""The current episode of an agent, stored stream by stream until the episode ends."""

from collections.abc import Sequence

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.replay.specs.layout import REWARD, Layout, Stream
from svfl_data.replay.specs.spec import Observation, Spec
from svfl_data.replay.stored_episode import StoredEpisode


class EpisodeBuilder:
    """Observations, actions and rewards of an episode since the reset.

    Args:
        spec: Spec of the replay buffer.
        layout: Layout of the replay buffer.
        observation: Observation after the reset, as for `ReplayBuffer.begin_episode`.
        expert: Whether the episode is a demonstration.

    Raises:
        FieldError: If an array of the observation is missing or has a wrong shape or value.
    """

    def __init__(self, spec: Spec, layout: Layout, observation: Observation, expert: bool) -> None:
        self._spec, self._layout, self._expert = spec, layout, expert
        self._pieces: dict[str, list[np.ndarray]] = {name: [] for name in layout.names()}
        self._before: dict[Stream, np.ndarray] = {}
        self._see(observation)

    def __len__(self) -> int:
        return len(self._pieces[REWARD])

    def add(self, action: np.ndarray, observation: Observation, reward: float) -> None:
        """Add an action, the observation after the action, and the reward of the action.

        Args:
            action: Commanded action, shape (C,), base axes.
            observation: Observation after the action, as for `ReplayBuffer.begin_episode`.
            reward: Reward of the action.

        Raises:
            FieldError: If the action, the observation or the reward has a wrong shape or value. The step is then not
                added.
        """
        acted = self._spec.acted(action)
        gained = finite(REWARD, np.asarray(reward), ()).astype(np.float32)
        self._see(observation)
        self._pieces[self._layout.action.name].append(acted[None])
        self._pieces[REWARD].append(gained[None])

    def finish(self, terminated: bool) -> StoredEpisode:
        """Return the whole episode.

        Args:
            terminated: Whether the task ended with the last action; if not, the episode was truncated.
        """
        arrays = {name: np.concatenate(pieces) for name, pieces in self._pieces.items()}
        return StoredEpisode(arrays, terminated, self._expert)

    def _see(self, observation: Observation) -> None:
        rows = self._spec.observed(observation, self._layout)
        for stream in self._layout.streams:
            if not stream.end:
                for one in stream.arrays:
                    self._pieces[one.name].append(rows[one.name])
                continue
            now = joined_rows([rows[one.name] for one in stream.arrays])
            new = unseen(self._before.get(stream, now[:0]), now)
            self._before[stream] = now
            for one in stream.arrays:
                self._pieces[one.name].append(self._spec.kept(one.name, rows[one.name][len(now) - new :]))
            ends = self._pieces[stream.end]
            ends.append((ends[-1] if ends else np.zeros(1, np.int64)) + new)
            for name in (stream.padded, stream.age):
                if name:
                    self._pieces[name].append(rows[name][None])
        for one in self._layout.vectors:
            self._pieces[one.name].append(self._spec.kept(one.name, rows[one.name])[None])


def joined_rows(windows: Sequence[np.ndarray]) -> np.ndarray:
    """Return windows of one clock as one array whose rows are equal where all their bytes are equal.

    Args:
        windows: Windows of T rows, shape (T, ...) each.

    Returns:
        Bytes of the rows, shape (T, number of bytes), uint8.
    """
    flat = [np.ascontiguousarray(window).reshape(len(window), -1).view(np.uint8) for window in windows]
    return flat[0] if len(flat) == 1 else np.concatenate(flat, axis=1)


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


def finite(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return a copy of values of the expected shape; environments may use their arrays again.

    Args:
        name: Name of the values in messages.
        values: The values.
        shape: Expected shape.

    Raises:
        FieldError: If the shape is another one, or a value is not a finite number.
    """
    found = np.asarray(values)
    if found.shape != shape:
        raise FieldError(f"{name} has shape {found.shape}, expected {shape}")
    if found.dtype.kind not in "fiub" or not np.isfinite(found).all():
        raise FieldError(f"{name} ({found.dtype}) holds something that is not a finite number")
    return np.array(found)
