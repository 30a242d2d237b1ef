"""Where a tagged object is: what is believed of a picture, and for how long."""

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
    """What a sighting must be to be believed.

    Attributes:
        margin: Least decision margin, in grey levels; tags below are left aside.
        hamming: Most corrected bits; tags above are left aside.
        error: Largest root mean square reprojection error of edges that are met, [px]. Usual are 0.1 to 0.3; where
            there are no tags, chance makes it 0.5.
        share: Least share of the edges on tags that face the camera which are met, 0 to 1. A cube of which a third is
            hidden has 0.6; one that is believed to be a few modules beside its place has 0.2 to 0.4.
    """

    margin: float = 30.0
    hamming: int = 1
    error: float = 0.45
    share: float = 0.45


@dataclass(frozen=True)
class Track:
    """The last believed pose of an object, never without its age.

    Attributes:
        pose: Position [m], quat_xyzw, base axes, (7,).
        age: Time since it was seen there, [s]; 0 in the picture itself.
        error: Root mean square reprojection error of its tags' edges then, [px].
        margin: Smallest decision margin then, in grey levels.
        tags: How many tags gave it.
    """

    pose: NDArray[np.float64]
    age: float
    error: float
    margin: float
    tags: int

    def fresh(self, age: float) -> bool:
        """Whether it is at most `age` seconds old."""
        return self.age <= age


class Tracker:
    """Follows one object through the pictures of one or several calibrated cameras.

    Attributes:
        refused: Why sightings were not believed, and how often.
    """

    def __init__(self, layout: Layout, upright: bool = False, limits: Limits | None = None) -> None:
        """Choose the object.

        Args:
            layout: Where its tags are.
            upright: Whether it is known to stand upright (z up), as a block that is pushed; not one that is lifted.
            limits: What is believed.
        """
        self.layout, self.upright, self.limits = layout, upright, limits or Limits()
        self.refused: Counter[str] = Counter()
        self._detect, self._edges = TagDetector(layout.family), Edges(layout)
        self._seen: tuple[int, Track] | None = None
        self._rows: list[tuple[int, Track]] = []

    def see(self, picture: NDArray[np.uint8], t_ns: int, camera: Calibration) -> Track | None:
        """Look at a picture.

        Args:
            picture: (H, W, 3) RGB or (H, W) grey, uint8, without lens distortion.
            t_ns: When it was taken, [ns]. One from before the last sighting, such as a slower camera's, tells nothing.
            camera: Of the camera that took it.

        Returns:
            What is known at the time of the latest picture, as `at`.
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
        """The last believed pose with its age at a time; None before the object has been seen."""
        if self._seen is None:
            return None
        seen_ns, track = self._seen
        return Track(track.pose, (t_ns - seen_ns) / 1e9, track.error, track.margin, track.tags)

    def arrays(self) -> dict[str, np.ndarray]:
        """The stream ``streams/tags/`` of an episode: a row for each look from the first sighting on, or nothing."""
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
        """As position and quat_xyzw, with the sign of the last one's."""
        pose = np.array([*T[:3, 3], *quat_from_matrix(T[:3, :3])])
        near = self._seen[1].pose[3:] if self._seen else np.array([0.0, 0.0, 0.0, 1.0])
        pose[3:] *= -1.0 if pose[3:] @ near < 0 else 1.0
        return pose


def quat_from_matrix(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation matrix as quat_xyzw, (4,)."""
    vector = cv2.Rodrigues(R)[0][:, 0]
    angle = float(np.linalg.norm(vector))
    return np.array([*(0.5 * np.sinc(0.5 * angle / np.pi) * vector), np.cos(0.5 * angle)])
