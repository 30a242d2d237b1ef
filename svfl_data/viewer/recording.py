"""An episode as a Rerun recording; images and wrench readings are read from disk in pieces, to limit memory."""

from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from svfl_data.signals.camera_poses import TCP_POSE, TCP_TIMES
from svfl_data.viewer.entities import names, plots, scene
from svfl_data.viewer.entities.cameras import log_camera
from svfl_data.viewer.entities.episode_source import ACTION, PROPRIO, TIMES, WRENCH, EpisodeSource
from svfl_data.viewer.entities.fields import FieldView, log_fields
from svfl_data.viewer.entities.robot import Robot, robot_for
from svfl_data.viewer.entities.wrenches import RULE as RULE  # imported for users of this module
from svfl_data.viewer.entities.wrenches import Loads, log_wrenches
from svfl_data.viewer.overlay import log_prediction
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.summary_text import summary_text

JOINTS = "streams/joints/position"
DRAWN_ROBOT = "panda"
"""Word in the name of the robots that are drawn without a URDF."""


@dataclass(frozen=True, eq=False)
class Summary:
    """What was found while an episode was logged, for the layout of the window.

    Attributes:
        loads: Ranges of the wrench and annotations.
        views: Views of the fields that have no drawing of their own.
    """

    loads: Loads
    views: tuple[FieldView, ...]


def log_episode(
    recording: rr.RecordingStream, shown: EpisodeSource, prediction: Prediction | None = None, urdf: Path | None = None
) -> Summary:
    """Log a whole episode: whatever it has of the arrays with a drawing of their own, and the other declared fields.

    Args:
        recording: Recording to log to.
        shown: Episode to log.
        prediction: Prediction of a network on the episode. None if no network is shown.
        urdf: URDF of the arm. None for the Panda of the simulation, which is drawn unless the episode is of another
            robot.

    Returns:
        Ranges, annotations and views of the episode, for the layout of the window.

    Raises:
        FormatError: If the episode's file has changed since it was opened, or the URDF does not fit the joints.
        FieldError: If a field does not fit its declaration, or a recorded transform needs one that is missing.
    """
    root, t_ns = shown.root, shown[TIMES]
    proprio = shown.get(PROPRIO)
    scene.log_environment(recording, root, shown.get("workspace"))
    parts = {"wrench": WRENCH in shown, "motion": shown.planar, "proprio": proprio is not None, "reward": True}
    plots.log_styles(recording, root, [name for name, there in parts.items() if there])
    robot = _log_robot(recording, shown, urdf)
    if proprio is not None:
        scene.send_gripper(recording, root, t_ns, proprio, boxes=robot is None)
        plots.send_proprio(recording, root, t_ns, proprio)
    elif TCP_POSE in shown:
        scene.send_tcp(recording, root, shown[TCP_TIMES], shown[TCP_POSE])
    if "streams/object/pose" in shown:
        half = shown.get("streams/object/half_extents")
        scene.send_object(recording, root, shown["streams/object/t_ns"], shown["streams/object/pose"], half)
    loads = log_wrenches(recording, shown)
    if shown.planar:
        plots.send_actions(recording, root, t_ns[:-1], shown[ACTION], proprio)
    plots.send_reward(recording, root, t_ns, shown.meta.success)
    if proprio is not None and "labels/offset" in shown and "labels/direction" in shown:
        offset, direction = shown["labels/offset"], int(shown["labels/direction"])
        scene.log_label(recording, root, int(t_ns[-1]), proprio[-1], offset, direction)
    for camera in shown.cameras:
        log_camera(recording, shown, camera)
    views = log_fields(recording, shown)
    if prediction:
        log_prediction(recording, shown, prediction)
    text = rr.TextDocument(summary_text(shown, loads.peak, prediction), media_type=rr.MediaType.MARKDOWN)
    recording.log(root + names.ABOUT, text, static=True)
    return Summary(loads, tuple(views))


def _log_robot(recording: rr.RecordingStream, shown: EpisodeSource, urdf: Path | None) -> Robot | None:
    """Log the arm if its joints were recorded and its shape is known."""
    other = bool(shown.meta.robot) and DRAWN_ROBOT not in shown.meta.robot.lower()
    if JOINTS not in shown or not len(shown.arrays[JOINTS]) or (other and urdf is None):
        return None
    joints = shown[JOINTS]
    robot = robot_for(joints.shape[1], urdf)
    if robot:
        robot.log(recording, shown.root)
        robot.send(recording, shown.root, shown["streams/joints/t_ns"], joints)
    return robot
