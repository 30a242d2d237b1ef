"""Tags in a colour picture: which, where their corners are, and how sure that is."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.native import native
from svfl_data.errors import UsageError

FIND, MEASURE = (2.0, 0.0), (1.0, 0.6)
"""Decimation, and blur [px], of the two looks: at half size where tags are, then at full size around each of them where
exactly its corners are. Hardly slower than the first alone, and as accurate as the second (docs/apriltags.md)."""
AROUND = 0.35  # of a tag's width that the second look sees beside it
HALF_PIXEL = 0.5  # the library counts from the corner of the first pixel, episode files from its centre


@dataclass(frozen=True)
class Detection:
    """One tag in a picture.

    Attributes:
        family: Its family.
        id: Its number in the family.
        corners: Lower left, lower right, upper right, upper left of the tag as one reads it, (4, 2), [px]; the centre
            of the first pixel is at (0, 0).
        margin: How far its bits are from undecided, in grey levels; below 20 to 30, false ones appear.
        hamming: Bits that were wrong and have been corrected.
    """

    family: str
    id: int
    corners: NDArray[np.float64]
    margin: float
    hamming: int

    @property
    def facing(self) -> float:
        """1 for a tag that faces the camera, towards 0 for one seen edge-on."""
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        (ax, ay), (bx, by) = self.corners[2] - self.corners[0], self.corners[3] - self.corners[1]
        return float(0.5 * abs(ax * by - ay * bx) / (edges**2).sum(axis=1).max())


class TagDetector:
    """Finds the tags of one family; as many as one likes, from any thread, before and after a fork.

    All detectors with the same settings share one native detector (`collectors.apriltags.native`).
    """

    def __init__(self, family: str = "tag36h11", find: tuple[float, float] = FIND) -> None:
        """Choose what to look for.

        Args:
            family: Family of the tags.
            find: Decimation (>= 1) and blur [px] of the first look. At 2, tags need about 20 pixels; at 1 half of that,
                and five times as long.

        Raises:
            UsageError: If there is no such family, or a number is out of bounds.
        """
        decimate, blur = map(float, find)
        if decimate < 1 or blur < 0:
            raise UsageError(f"decimation must be >= 1 and blur >= 0 px, got {decimate:g} and {blur:g}")
        self.family, self._find, self._measure = family, (family, decimate, blur), (family, *MEASURE)
        native(*self._find)

    def __call__(self, picture: NDArray[np.uint8]) -> list[Detection]:
        """Find the tags, sorted by id.

        Args:
            picture: (H, W, 3) RGB or (H, W) grey, uint8.

        Raises:
            UsageError: If it is something else.
        """
        gray = grayscale(picture)
        return sorted((self._again(gray, one) for one in self._look(gray, self._find)), key=lambda one: one.id)

    def _again(self, gray: NDArray[np.uint8], found: Detection) -> Detection:
        """Measure a tag at full size; if it is not found there, the first measurement stays."""
        low, high = found.corners.min(axis=0), found.corners.max(axis=0)
        beside = 4 + AROUND * (high - low).max()
        left, top = np.maximum(low - beside, 0).astype(int)
        right, bottom = (high + beside).astype(int) + 1
        for one in self._look(np.ascontiguousarray(gray[top:bottom, left:right]), self._measure):
            if one.id == found.id:
                return replace(one, corners=one.corners + np.array([left, top]))
        return found

    def _look(self, gray: NDArray[np.uint8], settings: tuple[str, float, float]) -> list[Detection]:
        return [
            Detection(self.family, one.tag_id, np.array(one.corners) - HALF_PIXEL, one.decision_margin, one.hamming)
            for one in native(*settings).detect(gray)
        ]


def grayscale(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture in grey levels, (H, W), contiguous.

    Args:
        picture: (H, W, 3) RGB or (H, W) grey, uint8.

    Raises:
        UsageError: If it is something else.
    """
    if picture.dtype != np.uint8 or not (picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] == 3)):
        raise UsageError(
            f"tags are looked for in (H, W, 3) RGB or (H, W) grey uint8 pictures, got {picture.shape} {picture.dtype}"
        )
    picture = np.ascontiguousarray(picture)
    if picture.ndim == 2:
        return picture
    gray: NDArray[np.uint8] = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)  # type: ignore[assignment]
    return gray
