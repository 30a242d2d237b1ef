"""An episode as the viewer reads it: arrays that may still be on disk, and the wrench stream in pieces."""

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
"""Number of wrench readings in one piece; about a minute at 500 Hz."""
TIMES, PROPRIO, ACTION = "observations/t_ns", "observations/proprio", "actions/action"
WRENCH_TIMES, WRENCH, TARE = "streams/wrench/t_ns", "streams/wrench/wrench", "streams/wrench/tare"
OF_EVERY_EPISODE = (TIMES, PROPRIO, ACTION, TARE, "workspace")
SETTLED = 16.0
"""Number of time constants after which the first reading has no effect on a low-pass in float32 (factor exp(-16))."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Piece of the wrench stream with M readings, in base axes, about the sensor origin.

    Attributes:
        t_ns: Timestamps of the readings, shape (M,), [ns].
        raw: Raw wrench of the sensor, shape (M, 6), [N] and [N m].
        wrench: Wrench after the recorded transforms, by default the tare, shape (M, 6), float32, [N] and [N m].
        size: Norm of the low-pass filtered force, by which contacts are found, shape (M,), float32, [N].
    """

    t_ns: np.ndarray
    raw: np.ndarray
    wrench: np.ndarray
    size: np.ndarray


@dataclass(frozen=True, eq=False)
class EpisodeSource:
    """Episode to be shown in the viewer.

    Attributes:
        meta: Metadata of the episode.
        arrays: Arrays of the episode by field path, in memory or on disk. Both give rows when indexed.
        root: Prefix of the episode's entities in the viewer: empty, or a folder such as ``episode_3/`` if several
            episodes are shown.
    """

    meta: Meta
    arrays: Mapping[str, np.ndarray | StoredArray]
    root: str = ""

    @classmethod
    def of(cls, episode: Episode | EpisodeReader, root: str = "") -> "EpisodeSource":
        """Prepare an episode, in memory or on disk, to be shown.

        Args:
            episode: Episode in memory, or reader of an episode on disk.
            root: Prefix of the episode's entities in the viewer.
        """
        if isinstance(episode, Episode):
            return cls(episode.meta, episode.arrays, root)
        return cls(episode.meta, {path: episode[path] for path in episode.paths}, root)

    def __getitem__(self, path: str) -> np.ndarray:
        """Return a whole array by its field path."""
        return np.asarray(self.arrays[path][()])

    def __contains__(self, path: object) -> bool:
        return path in self.arrays

    def __len__(self) -> int:
        return len(self.arrays[ACTION])

    @property
    def cameras(self) -> list[str]:
        """Names of the cameras."""
        return camera_names(self.arrays)

    def readings(self, rule: ContactRule, at_once: int = READINGS_AT_ONCE) -> Iterator[Readings]:
        """Read the wrench stream in pieces, with the same values as if it were processed as a whole.

        Args:
            rule: Rule for contacts, whose low-pass is used for `Readings.size`.
            at_once: Largest number of readings in a piece.

        Yields:
            Consecutive pieces.

        Raises:
            FormatError: If a recorded transform is unknown.
        """
        t_ns, stored = self[WRENCH_TIMES], self.arrays[WRENCH]
        settling_ns = self._settling_ns(rule)
        needed = {path: self[path] for path in OF_EVERY_EPISODE}
        for first in range(0, len(t_ns), at_once):
            after = min(first + at_once, len(t_ns))
            since = max(int(t_ns[first]) - settling_ns, -FARTHEST_NS)
            before = int(np.searchsorted(t_ns, since)) if settling_ns else first
            before = min(before, first)
            raw = np.asarray(stored[before:after])
            piece = Episode(self.meta, needed | {WRENCH_TIMES: t_ns[before:after], WRENCH: raw}, name="episode")
            new = slice(first - before, None)
            size = contact_force(piece, rule)[new].astype(np.float32)
            yield Readings(t_ns[first:after], raw[new], processed_wrench(piece)[new], size)

    def _settling_ns(self, rule: ContactRule) -> int:
        """Return how long before a piece the filters must start so that they have settled at the piece, [ns]."""
        found = [from_record(record, "episode") for record in self.meta.transforms]
        corners = [one.cutoff_hz for one in found if isinstance(one, LowPass)]
        corners += [rule.cutoff_hz] if rule.cutoff_hz else []
        return math.ceil(min(sum(SETTLED / (2 * math.pi * corner) for corner in corners) * 1e9, FARTHEST_NS))
