"""Are actions, positions, poses and labels possible, and do they agree with each other?"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from svfl_data.checks.finding import Finding, error, warning
from svfl_data.episode import Episode
from svfl_data.errors import FormatError
from svfl_data.symmetry import DIRECTIONS, OFFSET_PARTS, act
from svfl_data.transforms import recorded_transforms

MAX_MOVE_M, MAX_TURN_RAD = 0.025, np.pi / 16  # Kohler et al., CoRL 2023, section 5
ROUNDING = 1e-6  # float32 actions at their bound
UNIT = 1e-3  # how far the norm of a quaternion, or the product of a rotation with its transpose, may be off
OUTSIDE_M = 0.03  # an admittance controller lets contact push the hand out of the workspace by up to this
OPENING = 0.05  # fingers stop a little before or after their nominal range


def action_bounds(episode: Episode) -> tuple[float, float, str]:
    """Largest move [m] and turn [rad] of an action, and where they come from."""
    config = episode.meta.config.get("world", episode.meta.config)
    if isinstance(config, dict):
        move, turn = config.get("max_move"), config.get("max_turn")
        if isinstance(move, int | float) and isinstance(turn, int | float):
            return move, turn, "config"
    return MAX_MOVE_M, MAX_TURN_RAD, "the paper, the config says none"


def check_action(episode: Episode) -> Iterator[Finding]:
    """Actions are within the bounds of the configuration, or else of the paper."""
    move, turn, origin = action_bounds(episode)
    low = np.array([0.0, -move, -move, -move, -turn])
    high = np.array([1.0, move, move, move, turn])
    outside = (episode.action < low - ROUNDING) | (episode.action > high + ROUNDING)
    if outside.any():
        row, column = (int(i) for i in np.argwhere(outside)[0])
        name, unit = (("opening", ""), ("dx", " m"), ("dy", " m"), ("dz", " m"), ("dtheta", " rad"))[column]
        words = (
            f"{name} is {episode.action[row, column]:.4g}{unit}, outside {low[column]:.4g} to {high[column]:.4g}{unit} "
            f"(bounds: {origin}); {outside.any(axis=1).sum()} of {len(outside)} actions are out of bounds"
        )
        yield error(episode, "actions/action", row, words)


def check_proprio(episode: Episode) -> Iterator[Finding]:
    """The hand is where it can be: opening 0 to 1, TCP in the workspace."""
    opening, tcp = episode.proprio[:, 0], episode.proprio[:, 1:4]
    if len(rows := np.flatnonzero(np.abs(opening - 0.5) > 0.5 + OPENING)):
        words = f"gripper opening {opening[rows[0]]:.3g} is not within 0 to 1"
        yield warning(episode, "observations/proprio", int(rows[0]), words)
    beyond = np.maximum(episode.workspace[:, 0] - tcp, tcp - episode.workspace[:, 1])
    if (beyond > OUTSIDE_M).any():
        row, axis = (int(i) for i in np.argwhere(beyond > OUTSIDE_M)[0])
        words = f"TCP {'xyz'[axis]} = {tcp[row, axis]:.3f} m is {beyond[row, axis] * 1e3:.0f} mm outside the workspace"
        yield warning(episode, "observations/proprio", row, words)


def check_poses(episode: Episode) -> Iterator[Finding]:
    """Quaternions are unit, rotations are rotations, focal lengths and scales are positive, bounds are ordered."""
    if episode.has("object_pose"):
        norm = np.linalg.norm(episode.object_pose[:, 3:], axis=1)
        if len(rows := np.flatnonzero(np.abs(norm - 1) > UNIT)):
            words = f"quat_xyzw is not unit: norm {norm[rows[0]]:.4g} ({len(rows)} of {len(norm)} poses)"
            yield error(episode, "streams/object/pose", int(rows[0]), words)
    if (episode.workspace[:, 0] >= episode.workspace[:, 1]).any():
        axis = int((episode.workspace[:, 0] >= episode.workspace[:, 1]).argmax())
        yield error(episode, "workspace", axis, "the lower bound is not below the upper bound")
    for name, camera in episode.cameras.items():
        rotation, axes, focal = camera.T_base_camera[:3, :3], camera.image_axes, np.diag(camera.intrinsics)[:2]
        rigid = _orthogonal(rotation) and np.linalg.det(rotation) > 0
        if not rigid or not np.allclose(camera.T_base_camera[3], [0, 0, 0, 1], atol=UNIT):
            yield error(episode, f"cameras/{name}/T_base_camera", None, "not a pose: rotation or last row is off")
        if not _orthogonal(axes):
            yield error(episode, f"cameras/{name}/image_axes", None, "not an orthogonal matrix")
        if (focal <= 0).any():
            yield error(episode, f"cameras/{name}/intrinsics", None, f"focal lengths {focal.tolist()} px")
        if camera.has("depth_scale") and camera.depth_scale <= 0:
            words = f"{float(camera.depth_scale):g} m per unit of depth"
            yield error(episode, f"cameras/{name}/depth_scale", None, words)
        if camera.has("depth") and not camera.has("depth_scale"):
            yield error(episode, f"cameras/{name}/depth_scale", None, "missing, so the depth has no unit")


def _orthogonal(matrix: np.ndarray) -> bool:
    return bool(np.allclose(matrix @ matrix.T, np.eye(len(matrix)), atol=UNIT))


def check_label(episode: Episode) -> Iterator[Finding]:
    """Labels are there for the task that needs them, both or none, and the direction is nearest to the offset."""
    missing = [name for name in ("offset", "direction") if not episode.has(f"label_{name}")]
    if missing:
        if len(missing) == 1 or episode.meta.task == "centering":
            yield warning(episode, "labels", None, f"label missing: {' and '.join(missing)}")
        return
    direction = int(episode.label_direction)
    if not 0 <= direction < len(DIRECTIONS):
        yield error(episode, "labels/direction", None, f"direction {direction} is none of 0 to {len(DIRECTIONS) - 1}")
        return
    angle = direction * np.pi / 2
    towards = np.array([np.cos(angle), np.sin(angle)])
    offsets = [act(camera.image_axes, episode.label_offset, OFFSET_PARTS) for camera in episode.cameras.values()]
    # Nearest: no other direction has a larger component of the offset; either of two is right on their border.
    if offsets and not any(offset @ towards >= np.abs(offset).max() - 1e-9 for offset in offsets):
        x, y = offsets[0] * 1e3
        words = (
            f"label inconsistent: direction {DIRECTIONS[direction]}, but labels/offset points to "
            f"({x:+.1f}, {y:+.1f}) mm (right, up) in the image"
        )
        yield error(episode, "labels/direction", None, words)


def check_records(episode: Episode) -> Iterator[Finding]:
    """Recorded transforms can be applied; annotations have a name and lie within the episode."""
    try:
        recorded_transforms(episode)
    except FormatError as problem:
        yield error(episode, "transforms", None, str(problem).removeprefix(f"{episode.name}: "))
    last = max([int(episode.t_ns[-1]), *(int(t_ns) for t_ns in episode.wrench_t_ns[-1:])])
    for row, annotation in enumerate(episode.meta.annotations):
        facts: dict[str, Any] = annotation if isinstance(annotation, dict) else {}
        name, start, end = (facts.get(key) for key in ("name", "start_ns", "end_ns"))
        if not (isinstance(name, str) and isinstance(start, int) and isinstance(end, int)):
            yield error(episode, "annotations", row, "needs a name and integers start_ns and end_ns")
        elif not 0 <= start <= end <= last:
            words = f"{name!r} from {start / 1e9:.3f} to {end / 1e9:.3f} s is not within the episode"
            yield error(episode, "annotations", row, words)
