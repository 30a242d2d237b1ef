"""What the viewer reads of an episode: arrays that may still be on disk, and the wrench stream piece by piece."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.fields import FARTHEST_NS, camera_names
from svfl_data.signals.contact import ContactRule, contact_force
from svfl_data.signals.transforms import LowPass, from_record, processed_wrench
from svfl_data.storage.reader import EpisodeReader, StoredArray

READINGS_AT_ONCE = 2**15
"""Wrench readings in memory at a time: a minute at 500 Hz."""
TIMES, PROPRIO, ACTION = "observations/t_ns", "observations/proprio", "actions/action"
WRENCH_TIMES, WRENCH, TARE = "streams/wrench/t_ns", "streams/wrench/wrench", "streams/wrench/tare"
OF_EVERY_EPISODE = (TIMES, PROPRIO, ACTION, TARE, "workspace")
SETTLED = 16.0
"""Time constants after which a low-pass has forgotten its first reading, to the last bit of float32: exp(-16)."""


@dataclass(frozen=True, eq=False)
class Readings:
    """A piece of the wrench stream; base axes, about the sensor origin.

    Attributes:
        t_ns: Shape (M,), [ns].
        raw: As the sensor gave it, shape (M, 6), [N] and [N m].
        wrench: After the recorded transforms, by default the tare; shape (M, 6), float32.
        size: Norm of the low-passed force by which contacts are found, shape (M,), [N].
    """

    t_ns: np.ndarray
    raw: np.ndarray
    wrench: np.ndarray
    size: np.ndarray


@dataclass(frozen=True, eq=False)
class EpisodeSource:
    """An episode to be shown.

    Attributes:
        meta: What it is about.
        arrays: By dataset path, in memory or on disk; both give rows when indexed.
        root: Where its entities are: empty, or a folder such as ``episode_3/`` beside other episodes.
    """

    meta: Meta
    arrays: Mapping[str, np.ndarray | StoredArray]
    root: str = ""

    @classmethod
    def of(cls, episode: Episode | EpisodeReader, root: str = "") -> "EpisodeSource":
        """An episode in memory or on disk."""
        if isinstance(episode, Episode):
            return cls(episode.meta, episode.arrays, root)
        return cls(episode.meta, {path: episode[path] for path in episode.paths}, root)

    def __getitem__(self, path: str) -> np.ndarray:
        """All of an array."""
        return np.asarray(self.arrays[path][()])

    def __contains__(self, path: object) -> bool:
        return path in self.arrays

    def __len__(self) -> int:
        return len(self.arrays[ACTION])

    @property
    def cameras(self) -> list[str]:
        """Names of the cameras."""
        return camera_names(self.arrays)

    def readings(self, rule: ContactRule) -> Iterator[Readings]:
        """The wrench stream, piece by piece, as if it had been processed whole.

        Args:
            rule: Low-pass of `Readings.size`.

        Yields:
            Consecutive pieces.

        Raises:
            FormatError: If a recorded transform is unknown.
        """
        t_ns, stored = self[WRENCH_TIMES], self.arrays[WRENCH]
        settling_ns = self._settling_ns(rule)
        needed = {path: self[path] for path in OF_EVERY_EPISODE}
        for first in range(0, len(t_ns), READINGS_AT_ONCE):
            after = min(first + READINGS_AT_ONCE, len(t_ns))
            since = max(int(t_ns[first]) - settling_ns, -FARTHEST_NS)
            before = int(np.searchsorted(t_ns, since)) if settling_ns else first
            before = min(before, first)
            raw = np.asarray(stored[before:after])
            piece = Episode(self.meta, needed | {WRENCH_TIMES: t_ns[before:after], WRENCH: raw}, name="episode")
            new = slice(first - before, None)
            size = contact_force(piece, rule)[new].astype(np.float32)
            yield Readings(t_ns[first:after], raw[new], processed_wrench(piece)[new], size)

    def _settling_ns(self, rule: ContactRule) -> int:
        """How long before a piece its filters must begin."""
        found = [from_record(record, "episode") for record in self.meta.transforms]
        corners = [one.cutoff_hz for one in found if isinstance(one, LowPass)]
        corners += [rule.cutoff_hz] if rule.cutoff_hz else []
        return math.ceil(min(sum(SETTLED / (2 * math.pi * corner) for corner in corners) * 1e9, FARTHEST_NS))
