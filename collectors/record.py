"""The one recording loop: whoever acts, whatever the robot, an episode is recorded here."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

CAMERA = "front"
"""Name of a rig's one camera."""


class Observation(Protocol):
    """What is seen and felt at one step; shapes and units as declared in `svfl_data.fields`."""

    t_ns: int
    color: np.ndarray
    depth: np.ndarray
    proprio: np.ndarray
    joints: np.ndarray


class Camera(Protocol):
    """Calibration of a fixed camera; shapes and units as declared in `svfl_data.fields`."""

    depth_scale: float
    intrinsics: np.ndarray
    T_base_camera: np.ndarray
    image_axes: np.ndarray


class Rig(Protocol):
    """A robot with its sensors, simulated or real.

    One step is: `observe`, then `step` with the action commanded after it. The wrench stream runs on by itself at
    the sensor's own rate; `wrench_t_ns` and `wrench` hold everything read since the episode began.
    """

    tare_offset: np.ndarray

    @property
    def camera(self) -> Camera:
        """Calibration of its camera."""

    @property
    def workspace(self) -> np.ndarray:
        """Bounds of the TCP in base axes, shape (3, 2), [m]."""

    @property
    def wrench_t_ns(self) -> np.ndarray:
        """Time of every reading so far, shape (M,), int64, [ns]."""

    @property
    def wrench(self) -> np.ndarray:
        """Every reading so far, raw, shape (M, 6), float32, [N] and [N m], base axes, about the sensor origin."""

    def observe(self) -> Observation:
        """See and feel now."""

    def step(self, action: np.ndarray) -> None:
        """Carry out one action for one step of 50 ms."""


Policy = Callable[[Observation], np.ndarray | None]
"""Gives the next action (opening, dx, dy, dz, dtheta), or None to end the episode."""


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
    observations, actions = [rig.observe()], []
    poses = [track()] if track else []
    while len(actions) < max_steps and (chosen := policy(observations[-1])) is not None:
        action = np.asarray(chosen, dtype=np.float32)  # what is stored is what was commanded
        rig.step(action)
        actions.append(action)
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
