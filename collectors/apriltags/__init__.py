"""Fiducial tags that tell where an object or a camera is (docs/apriltags.md).

Tags serve reward, reset and calibration. What they tell never becomes part of an `Observation`: no policy sees it.

Axes of a tag and of a board as one reads them: x right, y up, z out of the paper. A tag's size is the edge of the
square between its four detected corners, which for most families is the outer edge of the black border.
"""
