"""Tracker of a tagged object, which decides whether a pose found in a picture is accepted, and measures its age."""

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.detector import TagDetector, grayscale
from collectors.apriltags.edges import Edges
from collectors.apriltags.layout import Layout
from collectors.apriltags.pose import body_pose
from svfl_data.schema.robot import Calibration


@dataclass(frozen=True)
class Limits:
    """Limits within which a detection of the object is accepted.

    Attributes:
        margin: Least decision margin of a tag, in grey levels; tags with a smaller margin are ignored.
        hamming: Largest number of corrected bits of a tag; tags with more are ignored.
        error: Largest root mean square reprojection error of the edges that are met, [px]. Usual values are 0.1 to 0.3;
            where there are no tags, chance gives about 0.5.
        share: Least share of the edges on tags facing the camera that are met, 0 to 1. A cube of which a third is
            hidden has 0.6; a pose that is a few modules beside the true one has 0.2 to 0.4.
    """

    margin: float = 30.0
    hamming: int = 1
    error: float = 0.45
    share: float = 0.45


@dataclass(frozen=True)
class Track:
    """Last accepted pose of an object, together with its age.

    Attributes:
        pose: Position [m], quat_xyzw, base axes, (7,).
        age: Time since the object was seen at this pose, [s]; 0 in the picture itself.
        error: Root mean square reprojection error of the tags' edges when the object was seen, [px].
        margin: Smallest decision margin of the tags when the object was seen, in grey levels.
        tags: Number of tags that the pose was found from.
    """

    pose: NDArray[np.float64]
    age: float
    error: float
    margin: float
    tags: int

    def fresh(self, age: float) -> bool:
        """Return whether the pose is at most `age` seconds old."""
        return self.age <= age


class Tracker:
    """Tracker of one object through the pictures of one or several calibrated cameras.

    Attributes:
        refused: Reasons for which detections were refused (``no tag``, ``unclear``, ``edges``), and how often each
            occurred.
    """

    def __init__(self, layout: Layout, upright: bool = False, limits: Limits | None = None) -> None:
        """Choose the object to follow.

        Args:
            layout: Layout of the tags on the object.
            upright: Whether the object is known to stand upright (z up), such as a block that is pushed, but not one
                that is lifted.
            limits: Limits within which a detection is accepted. None takes the defaults of `Limits`.
        """
        self.layout, self.upright, self.limits = layout, upright, limits or Limits()
        self.refused: Counter[str] = Counter()
        self._detect, self._edges = TagDetector(layout.family), Edges(layout)
        self._seen: tuple[int, Track] | None = None
        self._rows: list[tuple[int, Track]] = []

    def see(self, picture: NDArray[np.uint8], t_ns: int, camera: Calibration) -> Track | None:
        """Look for the object in a picture.

        Args:
            picture: Picture without lens distortion, (H, W, 3) RGB or (H, W) grey, uint8.
            t_ns: Time at which the picture was taken, [ns]. A picture from before the last sighting, such as one from a
                slower camera, is ignored.
            camera: Calibration of the camera that took the picture.

        Returns:
            The last accepted pose with its age at the time of the latest picture, as from `at`. It is None before the
            object has been seen.
        """
        if (self._seen is None or t_ns >= self._seen[0]) and (found := self._believed(picture, camera)):
            self._seen = (t_ns, found)
        now_ns = max(t_ns, self._rows[-1][0]) if self._rows else t_ns
        if track := self.at(now_ns):
            if self._rows and self._rows[-1][0] == now_ns:
                self._rows.pop()
            self._rows.append((now_ns, track))
        return track

    def at(self, t_ns: int) -> Track | None:
        """Return the last accepted pose with its age at the time `t_ns` [ns]; None before the object has been seen."""
        if self._seen is None:
            return None
        seen_ns, track = self._seen
        return Track(track.pose, (t_ns - seen_ns) / 1e9, track.error, track.margin, track.tags)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays of the stream ``streams/tags/`` of an episode, by dataset path.

        The stream has one row for each look from the first sighting on; without a sighting the result is empty.
        """
        if not self._rows:
            return {}
        tracks = [track for _, track in self._rows]
        stream = {
            "t_ns": np.array([t_ns for t_ns, _ in self._rows], np.int64),
            "pose": np.stack([track.pose for track in tracks]),
            "age": np.array([track.age for track in tracks]),
            "error": np.array([track.error for track in tracks]),
            "margin": np.array([track.margin for track in tracks]),
            "count": np.array([track.tags for track in tracks], np.int64),
        }
        return {f"streams/tags/{name}": values for name, values in stream.items()}

    def _believed(self, picture: NDArray[np.uint8], camera: Calibration) -> Track | None:
        limits, gray = self.limits, grayscale(picture)
        every = self._detect(gray)
        good = [one for one in every if one.margin >= limits.margin and one.hamming <= limits.hamming]
        up = camera.T_base_camera[2, :3] if self.upright else None
        found = body_pose(good, self.layout, camera.intrinsics, up)
        if found is None:
            self.refused["unclear" if every and len(good) < len(every) else "no tag"] += 1
            return None
        met = self._edges.meet(found.T_camera_body, gray, camera.intrinsics, up)
        if met.share < limits.share or met.error > limits.error:
            self.refused["edges"] += 1
            return None
        T = camera.T_base_camera @ met.T_camera_body
        return Track(self._pose(T), 0.0, met.error, found.margin, len(found.tags))

    def _pose(self, T: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a pose as position and quat_xyzw, with the sign of the quaternion chosen to be near the last one."""
        pose = np.array([*T[:3, 3], *quat_from_matrix(T[:3, :3])])
        near = self._seen[1].pose[3:] if self._seen else np.array([0.0, 0.0, 0.0, 1.0])
        pose[3:] *= -1.0 if pose[3:] @ near < 0 else 1.0
        return pose


def quat_from_matrix(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation of a matrix, (3, 3), as quat_xyzw, (4,)."""
    vector = cv2.Rodrigues(R)[0][:, 0]
    angle = float(np.linalg.norm(vector))
    return np.array([*(0.5 * np.sinc(0.5 * angle / np.pi) * vector), np.cos(0.5 * angle)])
