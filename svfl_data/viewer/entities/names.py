"""Names of the entities, the colours and the timeline, which are the same for recorded and live episodes."""

from collections.abc import Iterable

import numpy as np
import rerun as rr

APPLICATION = "svfl"
TIMELINE = "time"
"""Name of the only timeline, which counts seconds of the episode clock."""

SCENE, CAMERAS = "scene", "scene/cameras"
"""Entities of the 3-D scene and of its cameras; everything below SCENE is in base axes, in metres."""
PICTURES = "pictures"
"""Entity of the cameras whose place is not known, outside of the 3-D scene."""
FIELDS = "fields"
"""Entity of everything that is drawn from its declaration alone; the dataset path of the array follows."""
FORCE_PLOT, TORQUE_PLOT = "wrench/force", "wrench/torque"
RAW_FORCE, RAW_TORQUE = "wrench/raw/force", "wrench/raw/torque"
WINDOW_FORCE, WINDOW_TORQUE = "wrench/window/force", "wrench/window/torque"
SIZE, MARKS = "wrench/size", "wrench/marks"
COMMANDED, ACHIEVED = "motion/commanded", "motion/achieved"
POSITION, OPENING_AND_YAW = "proprio/position", "proprio/opening_and_yaw"
REWARD, ABOUT, PREDICTION = "reward", "about", "network"

# Okabe and Ito's palette, whose colours colour-blind people can distinguish. Each axis has the same colour everywhere.
AXES = ((213, 94, 0), (0, 158, 115), (86, 180, 233))
PALE_AXES = ((250, 190, 150), (150, 225, 200), (195, 225, 245))
FORCE, TORQUE, LABEL, BLOCK = (230, 159, 0), (204, 121, 167), (240, 228, 66), (0, 114, 178)
GREY, WHITE = (150, 150, 150), (255, 255, 255)
CURVES = (
    *AXES, FORCE, TORQUE, LABEL, BLOCK, GREY, *PALE_AXES, (250, 215, 140), (230, 190, 215), (250, 245, 180),
    (140, 185, 225), WHITE,
)  # fmt: skip
"""Colours of the curves of one plot, in the order of the components."""


def send(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, *columns: Iterable[rr.ComponentColumn]) -> None:
    """Log all rows of a stream in one call.

    Args:
        recording: Recording to log to.
        path: Entity of the stream.
        t_ns: Times of the rows on the episode clock, shape (N,), [ns]. If there are none, nothing is logged.
        columns: Rerun columns with N rows each.
    """
    if len(t_ns):
        clock = rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]"))
        recording.send_columns(path, [clock], [column for group in columns for column in group])
