"""The one recording loop: whoever acts, whatever the robot, an episode is recorded here."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from collectors.contract import Policy, Rig

CAMERA = "front"
"""Name of a rig's one camera."""


def record(
    rig: Rig, policy: Policy, max_steps: int, track: Callable[[], np.ndarray] | None = None
) -> dict[str, np.ndarray]:
    """Run a policy on a rig, which has been homed and tared, and keep everything.

    Args:
        rig: The robot.
        policy: Who acts.
        max_steps: Actions after which the episode ends if the policy has not ended it.
        track: Gives the pose of the task's object, shape (7,), where it is known.

    Returns:
        The arrays of the episode without labels, by dataset path.
    """
    observations = [rig.observe()]
    actions: list[NDArray[np.float32]] = []
    poses = [track()] if track else []
    while len(actions) < max_steps and (chosen := policy(observations[-1])) is not None:
        actions.append(np.asarray(chosen, dtype=np.float32))  # what is stored is what is commanded
        rig.step(actions[-1])
        observations.append(rig.observe())
        poses += [track()] if track else []
    t_ns = np.array([observation.t_ns for observation in observations], dtype=np.int64)

    def stacked(name: str) -> np.ndarray:
        return np.stack([getattr(observation, name) for observation in observations])

    arrays = {
        "observations/t_ns": t_ns,
        "observations/proprio": stacked("proprio"),
        "actions/action": np.array(actions, dtype=np.float32).reshape(-1, 5),
        "streams/wrench/t_ns": np.array(rig.wrench_t_ns),
        "streams/wrench/wrench": np.array(rig.wrench),
        "streams/wrench/tare": np.array(rig.tare_offset, dtype=np.float64),
        "streams/joints/t_ns": t_ns.copy(),
        "streams/joints/position": stacked("joints"),
        f"cameras/{CAMERA}/t_ns": t_ns.copy(),
        f"cameras/{CAMERA}/color": stacked("color"),
        f"cameras/{CAMERA}/depth": stacked("depth"),
        f"cameras/{CAMERA}/depth_scale": np.array(rig.camera.depth_scale),
        f"cameras/{CAMERA}/intrinsics": np.array(rig.camera.intrinsics),
        f"cameras/{CAMERA}/T_base_camera": np.array(rig.camera.T_base_camera),
        f"cameras/{CAMERA}/image_axes": np.array(rig.camera.image_axes),
        "workspace": np.array(rig.workspace),
    }
    if poses:
        arrays |= {"streams/object/t_ns": t_ns.copy(), "streams/object/pose": np.stack(poses)}
    return arrays
