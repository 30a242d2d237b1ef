"""The only mapping from what a robot observes to the arrays of an episode."""

from typing import Any

import numpy as np

from svfl_data.schema.robot import Calibration, Observation, Robot

Rows = dict[str, dict[str, Any]]
"""One row of each array by group, such as ``streams/joints``, and name."""


def constants(robot: Robot) -> dict[str, np.ndarray]:
    """Return the arrays that an episode has once, by dataset path: workspace, tare and calibration of the cameras.

    Args:
        robot: Robot that records the episode, homed and tared.
    """
    arrays = {"workspace": np.array(robot.workspace), "streams/wrench/tare": np.array(robot.tare_offset, np.float64)}
    for name, calibration in robot.cameras.items():
        arrays |= {f"cameras/{name}/{leaf}": values for leaf, values in _calibration(calibration).items()}
    return arrays


def rows(seen: Observation) -> Rows:
    """Return what was observed at a step as rows of an episode; the wrench is not among them, it has its own clock.

    Args:
        seen: The observation.
    """
    t_ns = np.array([seen.t_ns], np.int64)
    found: Rows = {
        "observations": {"t_ns": t_ns, "proprio": seen.proprio[None]},
        "streams/joints": {"t_ns": t_ns, "position": seen.joints[None]},
    }
    for name, frame in seen.frames.items():
        found[f"cameras/{name}"] = {"t_ns": t_ns, "color": frame.color[None], "depth": frame.depth[None]}
    if seen.tcp is not None:
        found["streams/tcp"] = {"t_ns": t_ns, "pose": np.asarray(seen.tcp, np.float64)[None]}
    return found


def _calibration(of: Calibration) -> dict[str, np.ndarray]:
    """Return the arrays of a camera's calibration; a camera on the gripper has a mount in the place of a pose."""
    found = {"intrinsics": np.array(of.intrinsics, np.float64), "depth_scale": np.array(of.depth_scale, np.float64)}
    if of.T_tcp_camera is not None:
        return found | {"T_tcp_camera": np.array(of.T_tcp_camera, np.float64)}
    pose = {"T_base_camera": np.array(of.T_base_camera, np.float64)}
    return found | pose | {"image_axes": np.array(of.image_axes, np.float64)}
