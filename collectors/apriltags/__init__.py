"""Fiducial tags that measure the pose of an object or a camera (docs/apriltags.md).

Tags serve reward, reset and calibration. Poses from tags never become part of an `Observation`: no policy sees them.

The axes of a tag and of a board are: x to the right, y up and z out of the paper, when the paper is read upright. The
size of a tag is the edge of the square between its four detected corners, which for most families is the outer edge of
the black border.
"""
