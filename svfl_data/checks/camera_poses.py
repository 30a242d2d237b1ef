"""Checks that the poses of cameras that move are complete, and that their motion is possible."""

from collections.abc import Iterator

import numpy as np

from svfl_data.checks.finding import Finding, places, travel_m, warning
from svfl_data.schema.episode import Episode

FASTEST_M_PER_S = 10.0  # no arm carries a camera faster
STILL_M = 1e-6  # poses that differ by less are the same
TRAVEL_M = 0.05  # a camera that moves with the arm has other poses where the TCP moved so far


def check_poses(episode: Episode) -> Iterator[Finding]:
    """Check the poses of all cameras that move: by themselves, or with the gripper on which they are mounted."""
    for camera in episode.cameras.values():
        group = f"cameras/{camera.name}"
        if camera.has("T_tcp_camera"):
            yield from _mounted(episode, group, camera.t_ns)
        if camera.has("T_base_camera_per_frame"):
            yield from _moving(episode, f"{group}/T_base_camera_per_frame", camera.t_ns, camera.T_base_camera_per_frame)


def _mounted(episode: Episode, group: str, t_ns: np.ndarray) -> Iterator[Finding]:
    """Check that the pose of the gripper is known at each frame of a camera that is mounted on it."""
    path = f"{group}/T_tcp_camera"
    if not episode.has("tcp_pose"):
        yield warning(episode, path, None, "the camera has no pose in base, because streams/tcp/pose is missing")
        return
    known = np.searchsorted(episode.tcp_t_ns, t_ns, side="right") > 0
    if len(rows := np.flatnonzero(~known)):
        words = f"{len(rows)} of {len(t_ns)} frames lie before the first pose of the TCP: {places(rows, t_ns)}"
        yield warning(episode, path, None, words)


def _moving(episode: Episode, path: str, t_ns: np.ndarray, poses: np.ndarray) -> Iterator[Finding]:
    """Check that a camera does not jump, and that its pose is not constant while the TCP moves."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    elapsed = np.maximum(np.diff(t_ns) / 1e9, 1e-9)
    if len(rows := np.flatnonzero(steps / elapsed > FASTEST_M_PER_S) + 1):
        words = f"the camera jumps by {steps[rows[0] - 1]:.3g} m at {places(rows, t_ns)}"
        yield warning(episode, path, int(rows[0]), words)
    if len(poses) > 1 and np.ptp(poses, axis=0).max() < STILL_M:
        moved = travel_m(episode, int(t_ns[0]), int(t_ns[-1]))
        if moved is not None and moved > TRAVEL_M:
            words = f"the pose never changes, while the gripper moved by {moved * 1e3:.0f} mm"
            yield warning(episode, path, 0, f"{words}; a fixed camera has T_base_camera")
