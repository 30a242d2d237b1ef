"""A recorded episode in the form in which a replay buffer with any inputs keeps it."""

from itertools import pairwise

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.replay.episode_builder import unseen
from svfl_data.replay.specs.layout import REWARD, Layout
from svfl_data.replay.specs.recorded_spec import RecordedSpec
from svfl_data.replay.stored_episode import StoredEpisode, sparse_reward
from svfl_data.sampling.batch import axes_key
from svfl_data.sampling.cut import axes_from_1, readings, rows_from_1
from svfl_data.sampling.ragged import rows_of
from svfl_data.schema.clocks import Clock
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import Window


def recorded_episode(episode: Episode, spec: RecordedSpec, layout: Layout) -> StoredEpisode:
    """Convert a recorded episode into a demonstration, with the rows that `svfl_data.sampling.cut` would take.

    Args:
        episode: Recorded episode that is fit for training (`svfl_data.checks.check_usable`).
        spec: Spec of the episode.
        layout: Layout of the replay buffer.

    Raises:
        DatasetError: If the episode has no actions, or a stream has another rate than its window.
        FieldError: If a group has no clock.
    """
    reward = sparse_reward(episode)
    steps = np.arange(len(episode.t_ns))
    arrays: dict[str, np.ndarray] = {}
    for stream in layout.streams:
        group = stream.group
        if f"{group}/t_ns" not in episode.arrays:
            raise FieldError(f"{episode.name}: has no {group}/t_ns")
        t_ns, clock = np.asarray(episode.arrays[f"{group}/t_ns"]), Clock.of(episode.meta, group)
        window = spec.inputs.groups.get(group, Window(stream.length))
        seen = rows_of([t_ns], [episode.t_ns], [clock], window, group, [episode.name])
        windows, padding = seen.last(steps, stream.length)
        rows, end = _once(windows)
        for one in stream.arrays:
            if not group.startswith("cameras/"):
                arrays[one.name] = readings(episode.arrays, one.name, rows)
            elif one.name == axes_key(group):
                arrays[one.name] = axes_from_1(episode.arrays, group.removeprefix("cameras/"), rows)
            else:
                arrays[one.name] = rows_from_1(episode.arrays[one.name], rows)
        arrays |= {stream.end: end, stream.padded: padding.sum(axis=1), stream.age: seen.age}
    for one in (*layout.vectors, layout.action):
        arrays[one.name] = np.array(episode.arrays[one.name])
    return StoredEpisode(arrays | {REWARD: reward}, terminated=episode.meta.success, expert=True)


def _once(windows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows in which each window is a run, without repeating what the window before has.

    Args:
        windows: Rows of each window, shape (S, T).

    Returns:
        Rows, shape (M,); and the number of rows up to the end of each window, shape (S,), int64.
    """
    pieces = [windows[0]]
    for before, now in pairwise(windows):
        pieces.append(now[len(now) - unseen(before[:, None], now[:, None]) :])
    return np.concatenate(pieces), np.cumsum([len(piece) for piece in pieces], dtype=np.int64)
