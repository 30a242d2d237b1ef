"""A network's prediction in the viewer: predicted and true direction on the images, probabilities, and actions."""

import numpy as np
import rerun as rr

from svfl_data.symmetry import DIRECTIONS
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.episode_source import TIMES, EpisodeSource
from svfl_data.viewer.entities.images import send_color
from svfl_data.viewer.entities.names import FORCE, LABEL, TORQUE, send
from svfl_data.viewer.entities.plots import send_curve
from svfl_data.viewer.predictions import Prediction, true_direction

ARROWS = np.array([(1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (0.0, 1.0)])
"""The directions right, up, left, down as vectors (x right, y down) in an image."""
COLORS = (names.AXES[0], names.AXES[1], names.AXES[2], TORQUE)


def log_prediction(recording: rr.RecordingStream, shown: EpisodeSource, prediction: Prediction) -> None:
    """Log the prediction of a network on an episode.

    Args:
        recording: Recording to log to.
        shown: Episode that is shown.
        prediction: Prediction of the network on this episode.
    """
    t_ns, root = shown[TIMES], shown.root
    if prediction.seen is not None:
        send_color(recording, f"{root}{names.PREDICTION}/seen", t_ns, prediction.seen, small=False)
    if prediction.crop is not None:
        _log_crop(recording, f"{shown.camera_entity(prediction.camera)}/seen", t_ns, prediction.crop)
    if prediction.probabilities is not None:
        lines = rr.SeriesLines(names=[f"p({name})" for name in DIRECTIONS], colors=COLORS, widths=2.0)
        recording.log(f"{root}{names.PREDICTION}/probability", lines, static=True)
        send_curve(recording, f"{root}{names.PREDICTION}/probability", t_ns, prediction.probabilities)
        _log_arrows(recording, shown, prediction, t_ns)
    if prediction.actions is not None:
        for path, columns, labels, colors in (
            ("move", slice(1, 4), ["dx network", "dy network", "dz network"], names.PALE_AXES),
            ("turn", slice(4, 5), ["dtheta network"], [names.PALE_AXES[0]]),
            ("opening", slice(0, 1), ["opening network"], [names.PALE_AXES[1]]),
        ):
            lines = rr.SeriesLines(names=labels, colors=colors, widths=1.5, interpolation_mode="StepAfter")
            recording.log(f"{root}{names.PREDICTION}/{path}", lines, static=True)
            send_curve(recording, f"{root}{names.PREDICTION}/{path}", t_ns, prediction.actions[:, columns])


def _log_crop(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, crop: np.ndarray) -> None:
    """Log the outline of the part of the image that the network sees."""
    first, after = crop[:, :2].astype(np.float32), crop[:, 2:].astype(np.float32)
    recording.log(path, rr.Boxes2D.from_fields(colors=[FORCE], radii=[0.25]), static=True)
    send(recording, path, t_ns, rr.Boxes2D.columns(centers=(first + after) / 2, half_sizes=(after - first) / 2))


def _log_arrows(recording: rr.RecordingStream, shown: EpisodeSource, prediction: Prediction, t_ns: np.ndarray) -> None:
    """Log the predicted direction as an arrow from the middle of the image, and the true direction below it."""
    camera = prediction.camera
    height, width = shown.arrays[f"cameras/{camera}/color"].shape[1:3]
    assert prediction.probabilities is not None
    best = prediction.probabilities.argmax(axis=1)
    sure = prediction.probabilities.max(axis=1)
    entity, middle = shown.camera_entity(camera), np.array([width / 2, height / 2])
    look = rr.Arrows2D.from_fields(colors=[FORCE], radii=[0.7], show_labels=True)
    recording.log(f"{entity}/predicted", look, static=True)
    words = [f"network: {DIRECTIONS[one]} {share:.0%}" for one, share in zip(best, sure, strict=True)]
    arrows = rr.Arrows2D.columns(
        vectors=ARROWS[best] * sure[:, None] * 0.42 * width, origins=np.tile(middle, (len(best), 1)), labels=words
    )
    send(recording, f"{entity}/predicted", t_ns, arrows)
    if (true := true_direction(shown, prediction)) is not None:
        below = middle + np.array([0.0, 0.2 * height])  # beside the predicted arrow, so that both can be read
        arrow = rr.Arrows2D(
            vectors=[ARROWS[true] * 0.3 * width], origins=[below], colors=[LABEL], radii=[0.35],
            labels=[f"true: {DIRECTIONS[true]}"], show_labels=True,
        )  # fmt: skip
        recording.log(f"{entity}/true", arrow, static=True)
