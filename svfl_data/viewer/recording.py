"""An episode as a Rerun recording; images and wrench readings are read from disk in pieces, to limit memory."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import rerun as rr

from svfl_data.signals.contact import CONTACT, ContactRule, contact_intervals
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.printable import printable
from svfl_data.system.progress import progress
from svfl_data.viewer import images, names, plots, scene
from svfl_data.viewer.episode_source import ACTION, PROPRIO, TIMES, WRENCH_TIMES, EpisodeSource
from svfl_data.viewer.overlay import log_prediction
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.robot import robot_for
from svfl_data.viewer.summary_text import summary_text

FRAMES_AT_ONCE = 256
EXACT_BYTES = 2**26
"""Largest size of a camera's colour images that are logged exactly, [bytes]: 3800 frames of 76 x 76, three minutes."""
ARROWS = 20_000
"""Largest number of readings that are all drawn as arrows; of more readings, only the latest at each observation is."""
RULE = ContactRule()


@dataclass(frozen=True, eq=False)
class Summary:
    """Ranges and annotations of an episode that are found while it is logged, for the layout of the window.

    Attributes:
        low: Smallest value of each component of the processed wrench, at most 0, shape (6,), [N] and [N m].
        high: Largest value of each component of the processed wrench, at least 0, shape (6,), [N] and [N m].
        peak: Largest norm of the filtered force, [N].
        annotations: Recorded annotations, contacts found here, and the label as an annotation.
    """

    low: np.ndarray
    high: np.ndarray
    peak: float
    annotations: tuple[dict, ...]


def log_episode(
    recording: rr.RecordingStream, shown: EpisodeSource, prediction: Prediction | None = None, urdf: Path | None = None
) -> Summary:
    """Log a whole episode.

    Args:
        recording: Recording to log to.
        shown: Episode to log.
        prediction: Prediction of a network on the episode. None if no network is shown.
        urdf: URDF of the arm. None for the Panda of the simulation.

    Returns:
        Ranges and annotations of the episode, for the layout of the window.

    Raises:
        FormatError: If the episode's file has changed since it was opened, or the URDF does not fit the joints.
        FieldError: If a field does not fit its declaration.
    """
    root, t_ns, proprio = shown.root, shown[TIMES], shown[PROPRIO]
    scene.log_environment(recording, root, shown["workspace"])
    plots.log_styles(recording, root)
    joints = shown["streams/joints/position"] if "streams/joints/position" in shown else np.empty((0, 0))
    robot = robot_for(joints.shape[1], urdf) if len(joints) else None
    if robot:
        robot.log(recording, root)
        robot.send(recording, root, shown["streams/joints/t_ns"], joints)
    scene.send_gripper(recording, root, t_ns, proprio, boxes=robot is None)
    if "streams/object/pose" in shown:
        half = _half_extents(shown)
        scene.send_object(recording, root, shown["streams/object/t_ns"], shown["streams/object/pose"], half)
    summary = _log_wrench(recording, shown, t_ns, proprio)
    plots.send_proprio(recording, root, t_ns, proprio)
    plots.send_actions(recording, root, t_ns[:-1], shown[ACTION], proprio)
    plots.send_reward(recording, root, t_ns, shown.meta.success)
    if "labels/offset" in shown and "labels/direction" in shown:
        offset, direction = shown["labels/offset"], int(shown["labels/direction"])
        scene.log_label(recording, root, int(t_ns[-1]), proprio[-1], offset, direction)
    for camera in shown.cameras:
        _log_camera(recording, shown, camera)
    if prediction:
        log_prediction(recording, shown, prediction)
    text = rr.TextDocument(summary_text(shown, summary.peak, prediction), media_type=rr.MediaType.MARKDOWN)
    recording.log(root + names.ABOUT, text, static=True)
    return summary


def _log_wrench(recording: rr.RecordingStream, shown: EpisodeSource, t_ns: np.ndarray, proprio: np.ndarray) -> Summary:
    """Log the wrench curves, arrows, annotations and the coloured TCP path in one pass over the readings."""
    clock, root = shown[WRENCH_TIMES], shown.root
    at_steps = np.searchsorted(clock, t_ns, side="right") - 1  # the latest reading of each observation
    chosen = np.arange(len(clock)) if len(clock) <= ARROWS else np.unique(at_steps[at_steps >= 0])
    chosen = chosen[clock[chosen] >= t_ns[0]] if len(chosen) else chosen  # the wrist's earlier position is not recorded
    size = np.zeros(len(clock), np.float32)
    low, high, first = np.zeros(6), np.zeros(6), 0
    for piece in shown.readings(RULE):
        plots.send_wrench(recording, root, piece)
        after = first + len(piece.t_ns)
        size[first:after] = piece.size
        low, high = np.minimum(low, piece.wrench.min(axis=0)), np.maximum(high, piece.wrench.max(axis=0))
        rows = chosen[(chosen >= first) & (chosen < after)] - first
        scene.send_arrows(recording, root, piece.t_ns[rows], piece.wrench[rows])
        recording.flush()
        first = after
    annotations = _annotations(shown, clock, size, t_ns)
    plots.send_marks(recording, root, annotations, level=float(low[:3].min() - 0.05 * np.ptp([low[:3], high[:3]])))
    peak = float(size.max(initial=0.0))
    if len(clock):
        scene.log_path(recording, root, proprio[:, 1:4], _force_on_the_way(at_steps, size), peak)
    return Summary(low, high, peak, tuple(annotations))


def _force_on_the_way(at_steps: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the largest force between each observation and the next, shape (N,), [N]."""
    edges = np.maximum(at_steps, 0)
    return np.array([size[first : max(after, first + 1)].max(initial=0.0) for first, after in pairwise(edges)])


def _half_extents(shown: EpisodeSource) -> np.ndarray | None:
    return shown["streams/object/half_extents"] if "streams/object/half_extents" in shown else None  # noqa: SIM401


def _annotations(shown: EpisodeSource, clock: np.ndarray, size: np.ndarray, t_ns: np.ndarray) -> list[dict]:
    """Return the recorded intervals, contacts found here if none were recorded, and the label at the last step."""
    found = [
        one
        for one in shown.meta.annotations
        if isinstance(one, dict) and "name" in one
        if all(isinstance(one.get(key), int) for key in ("start_ns", "end_ns"))
    ]
    if not any(one["name"] == CONTACT for one in found):
        spans = contact_intervals(clock, size, RULE)
        found += [{"name": CONTACT, "start_ns": start, "end_ns": end} for start, end in spans]
    if "labels/direction" in shown and len(t_ns) > 1:
        name = f"label: {DIRECTIONS[int(shown['labels/direction'])]}"
        found.append({"name": name, "start_ns": int(t_ns[-2]), "end_ns": int(t_ns[-1])})
    return found


def _log_camera(recording: rr.RecordingStream, shown: EpisodeSource, camera: str) -> None:
    """Log the calibration and the images of a camera."""
    entity, group = images.camera_entity(shown.root, camera), f"cameras/{camera}"
    color, clock = shown.arrays[f"{group}/color"], shown[f"{group}/t_ns"]
    rows, height, width = color.shape[:3]
    pose = shown[f"{group}/T_base_camera"]
    images.log_camera(recording, entity, shown[f"{group}/intrinsics"], pose, (height, width))
    small = int(np.prod(color.shape)) > EXACT_BYTES
    depth = shown.arrays.get(f"{group}/depth")
    pieces = range(0, rows, FRAMES_AT_ONCE)
    for first in progress(pieces, printable(f"pictures of {camera}")) if small else pieces:
        piece = slice(first, min(first + FRAMES_AT_ONCE, rows))
        images.send_color(recording, entity, clock[piece], np.asarray(color[piece]), small)
        if depth is not None:
            pictures = np.asarray(depth[piece])
            if first == 0:
                scale = float(shown[f"{group}/depth_scale"])
                images.log_depth_style(recording, entity, pictures, scale, small)
            images.send_depth(recording, entity, clock[piece], pictures, small)
        recording.flush()
