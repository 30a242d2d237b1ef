"""Checks that actions, proprioception, labels, transforms and annotations are possible and agree with each other."""

from collections.abc import Iterator
from typing import Any, TypeGuard

import numpy as np

from svfl_data.checks.finding import Finding, error, warning
from svfl_data.checks.timestamps import clocks
from svfl_data.errors import FormatError
from svfl_data.schema.action_bounds import ActionBounds
from svfl_data.schema.episode import Episode
from svfl_data.schema.field_words import assumed_words
from svfl_data.schema.fields import FARTHEST_NS
from svfl_data.signals.transforms import Tare, recorded_transforms
from svfl_data.symmetry import DIRECTIONS, OFFSET_PARTS, act, points_towards

OUTSIDE_M = 0.03  # contact may push the gripper out of the workspace this far, through an admittance controller
OPENING = 0.05  # the fingers may stop this far outside their nominal range of 0 to 1


def check_action(episode: Episode) -> Iterator[Finding]:
    """Check that every action is within the bounds that its array declares; beyond assumed bounds is a warning."""
    for path, actions in episode.arrays.items():
        field = episode.declarations.at(path) if path.startswith("actions/") else None
        bounds = ActionBounds.of(field) if field else None
        if bounds and (fault := bounds.fault(actions)):
            yield (warning if bounds.assumed else error)(episode, path, *fault)


def check_proprio(episode: Episode) -> Iterator[Finding]:
    """Check that the gripper opening is between 0 and 1, and that the TCP is in the workspace."""
    if not episode.has("proprio"):
        return
    opening, tcp = episode.proprio[:, 0], episode.proprio[:, 1:4]
    if len(rows := np.flatnonzero(np.abs(opening - 0.5) > 0.5 + OPENING)):
        words = f"gripper opening {opening[rows[0]]:.3g} is not within 0 to 1"
        yield warning(episode, "observations/proprio", int(rows[0]), words)
    if not episode.has("workspace"):
        return
    beyond = np.maximum(episode.workspace[:, 0] - tcp, tcp - episode.workspace[:, 1])
    if (beyond > OUTSIDE_M).any():
        row, axis = (int(i) for i in np.argwhere(beyond > OUTSIDE_M)[0])
        words = f"TCP {'xyz'[axis]} = {tcp[row, axis]:.3f} m is {beyond[row, axis] * 1e3:.0f} mm outside the workspace"
        yield warning(episode, "observations/proprio", row, words)


def check_assumptions(episode: Episode) -> Iterator[Finding]:
    """Warn of everything in the declarations that is an assumption, because the source of the data did not say it."""
    for path in episode.arrays:
        for words in assumed_words(field) if (field := episode.declarations.at(path)) else ():
            yield warning(episode, path, None, f"{words}; the source of the data did not say")


def check_label(episode: Episode) -> Iterator[Finding]:
    """Check the labels ``labels/offset`` and ``labels/direction`` of an episode.

    The task ``centering`` needs both labels; other tasks have both or none. The direction must be the nearest one to
    the offset in the image of at least one camera.
    """
    missing = [name for name in ("offset", "direction") if not episode.has(f"label_{name}")]
    if missing:
        if len(missing) == 1 or episode.meta.task == "centering":
            yield warning(episode, "labels", None, f"label missing: {' and '.join(missing)}")
        return
    direction = int(episode.label_direction)
    seen_by = [camera for camera in episode.cameras.values() if camera.has("image_axes")]
    offsets = [act(camera.image_axes, episode.label_offset, OFFSET_PARTS) for camera in seen_by]
    if offsets and not any(points_towards(direction, offset) for offset in offsets):
        x, y = offsets[0] * 1e3
        words = (
            f"label inconsistent: direction {DIRECTIONS[direction]}, but labels/offset points to "
            f"({x:+.1f}, {y:+.1f}) mm (right, up) in the image"
        )
        yield error(episode, "labels/direction", None, words)


def check_records(episode: Episode) -> Iterator[Finding]:
    """Check that recorded transforms can be applied, and that annotations have a name and lie within the episode."""
    try:
        found = recorded_transforms(episode)
    except FormatError as problem:
        yield error(episode, "transforms", None, str(problem).removeprefix(f"{episode.name}: "))
    else:
        if episode.has("wrench") and not episode.has("tare") and Tare() in found:
            yield error(episode, "transforms", None, "the tare is to be subtracted, but the episode has none")
    last = max(int(t_ns[-1]) for t_ns in clocks(episode).values() if len(t_ns))
    for row, annotation in enumerate(episode.meta.annotations):
        facts: Any = annotation if isinstance(annotation, dict) else {}
        name, start, end = (facts.get(key) for key in ("name", "start_ns", "end_ns"))
        if not isinstance(name, str) or not _is_time(start) or not _is_time(end):
            yield error(episode, "annotations", row, "needs a name and integers start_ns and end_ns")
        elif not 0 <= start <= end <= last:
            words = f"{name!r} from {start / 1e9:.3f} to {end / 1e9:.3f} s is not within the episode"
            yield error(episode, "annotations", row, words)


def _is_time(value: object) -> TypeGuard[int]:
    return type(value) is int and abs(value) <= FARTHEST_NS
