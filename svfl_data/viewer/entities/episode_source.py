"""An episode as the viewer reads it: arrays that may still be on disk, and the wrench stream in pieces."""

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from svfl_data.schema.action_fields import ACTION, planar_action
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field_words import OBSERVED as TIMES
from svfl_data.schema.field_words import camera_pose
from svfl_data.schema.fields import FARTHEST_NS, camera_names
from svfl_data.signals.camera_poses import TCP_POSE, TCP_TIMES
from svfl_data.signals.contact import ContactRule, contact_force
from svfl_data.signals.transforms import LowPass, from_record, processed_wrench
from svfl_data.storage.reader import EpisodeReader, StoredArray
from svfl_data.viewer.entities.names import CAMERAS, PICTURES

READINGS_AT_ONCE = 2**15
"""Number of wrench readings in one piece; about a minute at 500 Hz."""
PROPRIO = "observations/proprio"
WRENCH_TIMES, WRENCH, TARE = "streams/wrench/t_ns", "streams/wrench/wrench", "streams/wrench/tare"
PLANAR = planar_action().components
NEEDED = (TIMES, PROPRIO, TARE, "workspace")
"""Arrays that transforms of the wrench may need besides its readings."""
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
        declarations: Declarations of the arrays.
    """

    meta: Meta
    arrays: Mapping[str, np.ndarray | StoredArray]
    root: str = ""
    declarations: Declarations = STANDARD

    @classmethod
    def of(cls, episode: Episode | EpisodeReader, root: str = "") -> "EpisodeSource":
        """Prepare an episode, in memory or on disk, to be shown.

        Args:
            episode: Episode in memory, or reader of an episode on disk.
            root: Prefix of the episode's entities in the viewer.
        """
        if isinstance(episode, Episode):
            return cls(episode.meta, episode.arrays, root, episode.declarations)
        arrays = {path: episode[path] for path in episode.paths}
        return cls(episode.meta, arrays, root, episode.declarations)

    def __getitem__(self, path: str) -> np.ndarray:
        """Return a whole array by its field path."""
        return np.asarray(self.arrays[path][()])

    def get(self, path: str) -> np.ndarray | None:
        """Return a whole array by its field path; None if it was not recorded."""
        return self[path] if path in self.arrays else None

    def __contains__(self, path: object) -> bool:
        return path in self.arrays

    def __len__(self) -> int:
        return len(self.arrays[TIMES]) - 1

    @property
    def cameras(self) -> list[str]:
        """Names of the cameras."""
        return camera_names(self.arrays)

    @property
    def planar(self) -> bool:
        """Whether ``actions/action`` is the planar action: gripper opening, dx, dy, dz, dtheta."""
        field = self.declarations.at(ACTION)
        return ACTION in self and field is not None and field.components == PLANAR

    @functools.cached_property
    def span_ns(self) -> tuple[int, int]:
        """First and last time of all declared streams, [ns]."""
        clocks = [self[path] for path in self.arrays if path.endswith("/t_ns") and self.declarations.at(path)]
        return min(int(t[0]) for t in clocks if len(t)), max(int(t[-1]) for t in clocks if len(t))

    def positions(self) -> tuple[int, np.ndarray] | None:
        """Return where the TCP is at each observation, as far as it was recorded.

        Returns:
            First row of the observations at which the position is known, and the positions from there on, shape
            (N+1-first, 3), [m], base axes: those of the proprioception or, without it, of the latest pose of the TCP at
            or before the observation. None if there is neither.
        """
        if PROPRIO in self:
            return 0, self[PROPRIO][:, 1:4]
        if TCP_POSE not in self or not len(self.arrays[TCP_POSE]):
            return None
        rows = np.searchsorted(self[TCP_TIMES], self[TIMES], side="right") - 1
        first = int((rows < 0).sum())
        return first, self[TCP_POSE][rows[first:], :3]

    def placed(self, camera: str) -> bool:
        """Return whether pose and lens of a camera are known, so that it can be drawn in the 3-D scene.

        Args:
            camera: Name of the camera.
        """
        pose = camera_pose(camera, self.arrays)
        known = pose in ("", "moves") or (pose == "on the gripper" and TCP_POSE in self)
        return known and f"cameras/{camera}/intrinsics" in self

    def camera_entity(self, camera: str) -> str:
        """Return the entity of a camera: in the 3-D scene if the camera can be drawn there, otherwise outside of it.

        Args:
            camera: Name of the camera.
        """
        return f"{self.root}{CAMERAS if self.placed(camera) else PICTURES}/{camera}"

    def readings(self, rule: ContactRule, at_once: int = READINGS_AT_ONCE) -> Iterator[Readings]:
        """Read the wrench stream in pieces, with the same values as if it were processed as a whole.

        Args:
            rule: Rule for contacts, whose low-pass is used for `Readings.size`.
            at_once: Largest number of readings in a piece.

        Yields:
            Consecutive pieces.

        Raises:
            FieldError: If a recorded transform needs an array that was not recorded.
            FormatError: If a recorded transform is unknown.
        """
        if WRENCH not in self:
            return
        t_ns, stored = self[WRENCH_TIMES], self.arrays[WRENCH]
        settling_ns = self._settling_ns(rule)
        action = next(path for path in self.arrays if path.startswith("actions/"))
        needed = {path: self[path] for path in (*NEEDED, action) if path in self}
        for first in range(0, len(t_ns), at_once):
            after = min(first + at_once, len(t_ns))
            since = max(int(t_ns[first]) - settling_ns, -FARTHEST_NS)
            before = int(np.searchsorted(t_ns, since)) if settling_ns else first
            before = min(before, first)
            raw = np.asarray(stored[before:after])
            arrays = needed | {WRENCH_TIMES: t_ns[before:after], WRENCH: raw}
            piece = Episode(self.meta, arrays, "episode", self.declarations)
            new = slice(first - before, None)
            size = contact_force(piece, rule)[new].astype(np.float32)
            yield Readings(t_ns[first:after], raw[new], processed_wrench(piece)[new], size)

    def _settling_ns(self, rule: ContactRule) -> int:
        """Return how long before a piece the filters must start so that they have settled at the piece, [ns]."""
        found = [from_record(record, "episode") for record in self.meta.transforms]
        corners = [one.cutoff_hz for one in found if isinstance(one, LowPass)]
        corners += [rule.cutoff_hz] if rule.cutoff_hz else []
        return math.ceil(min(sum(SETTLED / (2 * math.pi * corner) for corner in corners) * 1e9, FARTHEST_NS))
