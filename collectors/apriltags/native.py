"""Native detectors of pupil-apriltags: shared, never freed, used by one caller at a time, made anew after a fork.

This module works around the following faults of pupil-apriltags 1.0.4: ``Detector.__del__`` frees the families before
the detector that still uses them, which sooner or later corrupts the heap (pupil-labs/apriltags issues 46 and 52); a
detector that two threads use at once corrupts it too; detector threads do not survive a fork; of several families only
the first is added; the sharpening is rounded to 0; and large families get tables of several gigabytes.
"""

import ctypes
import os
import threading
from dataclasses import dataclass, field

import numpy as np
import pupil_apriltags
from numpy.typing import NDArray
from pupil_apriltags import bindings

from svfl_data.errors import UsageError

CORRECTED = {
    "tag36h11": 2,
    "tag25h9": 2,
    "tag16h5": 0,
    "tagStandard41h12": 2,
    "tagStandard52h13": 1,
    "tagCircle21h7": 1,
    "tagCircle49h12": 1,
    "tagCustom48h12": 1,
}
"""Tag families, and the number of wrong bits of a tag that are corrected.

The number is smaller for families whose codes are close to each other, or whose table would otherwise need too much
memory (2 for tagCircle49h12 would take 3.9 GB, 1 takes 0.16 GB)."""
SHARPENING = 0.25  # strength of the sharpening of the picture before its bits are read; the library's default


class _Immortal(pupil_apriltags.Detector):
    """Detector of the library that is never freed."""

    def __del__(self) -> None:
        """Leave the detector's memory allocated."""


@dataclass
class Native:
    """Native detector of one family, and the lock that lets one caller at a time use it.

    Attributes:
        library: Detector of pupil-apriltags.
        family: C structure of the tag family.
        lock: Lock that a caller holds while the detector works.
    """

    library: _Immortal
    family: ctypes.Structure
    lock: threading.Lock = field(default_factory=threading.Lock)

    def detect(self, gray: NDArray[np.uint8]) -> list[pupil_apriltags.Detection]:
        """Find the tags in a grey picture, (H, W) uint8, waiting until no other thread uses the detector."""
        with self.lock:
            found: list[pupil_apriltags.Detection] = self.library.detect(gray)
        return found


_natives: dict[tuple[str, float, float], Native] = {}
_making = threading.Lock()


def native(family: str, decimate: float = 1.0, blur: float = 0.0) -> Native:
    """Return this process's detector for a family and settings, which the first call creates within about a second.

    Args:
        family: One of `CORRECTED`.
        decimate: Factor by which the picture is made smaller to look for squares.
        blur: Standard deviation of the blur of the picture before that search, [px].

    Raises:
        UsageError: If `family` is not one of `CORRECTED`.
    """
    if family not in CORRECTED:
        raise UsageError(f"no tag family {family!r}; the families are {', '.join(CORRECTED)}")
    with _making:
        key = (family, decimate, blur)
        if key not in _natives:
            _natives[key] = _make(*key)
        return _natives[key]


def _make(family: str, decimate: float, blur: float) -> Native:
    library = _Immortal(families="tag16h5", nthreads=1, quad_decimate=decimate, quad_sigma=blur)  # a small table
    clib, detector = library.libc, library.tag_detector_ptr
    clib.apriltag_detector_clear_families(detector)
    create = getattr(clib, f"{family}_create")
    create.restype = ctypes.POINTER(bindings._ApriltagFamily)
    made = create()
    clib.apriltag_detector_add_family_bits(detector, made, CORRECTED[family])
    detector.contents.decode_sharpening = SHARPENING
    return Native(library, made.contents)


def _after_fork() -> None:
    """Drop all detectors in a forked child, since another thread may have held a lock or been inside a detector."""
    global _making
    _natives.clear()
    _making = threading.Lock()


os.register_at_fork(after_in_child=_after_fork)
