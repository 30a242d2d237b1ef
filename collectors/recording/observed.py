"""The only mapping from what a robot observes at a step to rows of an episode."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from svfl_data.schema.robot import Calibration, Observation

Rows = dict[str, dict[str, Any]]
"""One row of each array by group, such as ``streams/joints``, and name."""


def rows(seen: Observation, cameras: Mapping[str, Calibration | None]) -> Rows:
    """Return what was observed at a step as rows of an episode.

    Streams of `Observation.values` and the wrench are not among them: their rows come from `Robot.readings`.

    Args:
        seen: The observation.
        cameras: Calibration of each camera of the robot by name.
    """
    t_ns = np.array([seen.t_ns], np.int64)
    found: Rows = {"observations": {"t_ns": t_ns}}
    if seen.proprio is not None:
        found["observations"]["proprio"] = seen.proprio[None]
    if seen.joints is not None:
        found["streams/joints"] = {"t_ns": t_ns, "position": seen.joints[None]}
    for name, frame in seen.frames.items():
        at = t_ns if frame.t_ns is None else np.array([frame.t_ns], np.int64)
        images = {"color": frame.color[None]} | ({} if frame.depth is None else {"depth": frame.depth[None]})
        found[f"cameras/{name}"] = {"t_ns": at, **images}
        mounted = (known := cameras.get(name)) is not None and known.T_tcp_camera is not None
        if frame.T_base_camera is not None and not mounted:  # of a mounted one, mount and TCP tell the pose
            found[f"cameras/{name}"]["T_base_camera_per_frame"] = np.asarray(frame.T_base_camera, np.float64)[None]
    if seen.tcp is not None:
        found["streams/tcp"] = {"t_ns": t_ns, "pose": np.asarray(seen.tcp, np.float64)[None]}
    for path, values in seen.values.items():
        group, _, name = path.rpartition("/")
        if not group.startswith("streams"):
            found.setdefault(group, {"t_ns": t_ns})[name] = np.asarray(values)[None]
    return found
