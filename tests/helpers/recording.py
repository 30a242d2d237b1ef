"""Recording an episode of arrays through `EpisodeWriter`."""

from dataclasses import replace

import numpy as np

from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.declarations import STANDARD
from tests.helpers.builders import make_episode


def constants_of(arrays):
    return {path: array for path, array in arrays.items() if (field := STANDARD.at(path)) and not field.grows}


def groups_of(arrays):
    groups: dict[str, dict[str, np.ndarray]] = {}
    for path, array in arrays.items():
        field = STANDARD.at(path)
        if field is None or field.grows:
            group, _, name = path.rpartition("/")
            groups.setdefault(group, {})[name] = array
    return groups


def append_all(writer, arrays, pieces=3, rng=None):
    """Append every group in pieces of random sizes, the groups taking turns as they do on a robot."""
    rng = rng or np.random.default_rng(0)
    for piece in range(pieces):
        for group, columns in groups_of(arrays).items():
            rows = len(next(iter(columns.values())))
            cuts = np.sort(np.random.default_rng([rows, pieces]).integers(0, rows + 1, pieces - 1))
            start, stop = np.concatenate([[0], cuts, [rows]])[piece : piece + 2]
            writer.append(group, **{name: array[start:stop] for name, array in columns.items()})
        if rng.random() < 0.5:
            writer.flush()


def start(dataset, episode=None, **kwargs):
    episode = episode or make_episode()
    return EpisodeWriter(dataset, replace(episode.meta, index=NEXT), constants_of(episode.arrays), **kwargs)
