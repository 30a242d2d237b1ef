"""Detector of tags in a picture, which gives their ids, their corners and how certain each detection is."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.native import native
from svfl_data.errors import UsageError

FIND, MEASURE = (2.0, 0.0), (1.0, 0.6)
"""Decimation and blur [px] of the two looks at a picture.

The first look finds tags at half size; the second measures the corners of each tag at full size, in the region around
it. Both together are hardly slower than the first look alone, and as accurate as the second (docs/apriltags.md)."""
AROUND = 0.35  # width that the second look sees beside a tag, relative to the tag's width
HALF_PIXEL = 0.5  # the library counts pixels from the corner of the first pixel, episode files from its centre


@dataclass(frozen=True)
class Detection:
    """Tag found in a picture.

    Attributes:
        family: Family of the tag.
        id: Id of the tag in its family.
        corners: Lower left, lower right, upper right and upper left corner of the tag when it is read upright, (4, 2),
            [px]; the centre of the first pixel is at (0, 0).
        margin: Difference of the tag's bits from the threshold between black and white, in grey levels; below 20 to 30,
            false detections appear.
        hamming: Number of bits that were wrong and have been corrected.
    """

    family: str
    id: int
    corners: NDArray[np.float64]
    margin: float
    hamming: int

    @property
    def facing(self) -> float:
        """Measure of how squarely the tag faces the camera: 1 for a tag that faces it, 0 for one seen edge-on."""
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        (ax, ay), (bx, by) = self.corners[2] - self.corners[0], self.corners[3] - self.corners[1]
        return float(0.5 * abs(ax * by - ay * bx) / (edges**2).sum(axis=1).max())


class TagDetector:
    """Detector of the tags of one family, which any number of threads may use, also after a fork.

    All detectors with the same settings share one native detector (`collectors.apriltags.native`).
    """

    def __init__(self, family: str = "tag36h11", find: tuple[float, float] = FIND) -> None:
        """Choose the tags to look for.

        Args:
            family: Family of the tags.
            find: Decimation (>= 1) and blur [px] of the first look. With a decimation of 2, tags must be about 20
                pixels wide; with 1 half of that, and the search takes five times as long.

        Raises:
            UsageError: If there is no such family, or a value of `find` is out of bounds.
        """
        decimate, blur = map(float, find)
        if decimate < 1 or blur < 0:
            raise UsageError(f"decimation must be >= 1 and blur >= 0 px, got {decimate:g} and {blur:g}")
        self.family, self._find, self._measure = family, (family, decimate, blur), (family, *MEASURE)
        native(*self._find)

    def __call__(self, picture: NDArray[np.uint8]) -> list[Detection]:
        """Find the tags in a picture.

        Args:
            picture: Picture, (H, W, 3) RGB or (H, W) grey, uint8.

        Returns:
            The tags that were found, sorted by id.

        Raises:
            UsageError: If the picture has another shape or type.
        """
        gray = grayscale(picture)
        return sorted((self._again(gray, one) for one in self._look(gray, self._find)), key=lambda one: one.id)

    def _again(self, gray: NDArray[np.uint8], found: Detection) -> Detection:
        """Measure a tag again at full size; if it is not found there, the first measurement is kept."""
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
    """Return a picture in grey levels, (H, W) uint8, contiguous in memory.

    Args:
        picture: Picture, (H, W, 3) RGB or (H, W) grey, uint8.

    Raises:
        UsageError: If the picture has another shape or type.
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
