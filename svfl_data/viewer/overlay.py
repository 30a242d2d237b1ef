"""A network's prediction in the viewer: predicted and true direction on the images, probabilities, and actions."""

from dataclasses import replace

import numpy as np
import rerun as rr

from svfl_data.symmetry import DIRECTIONS
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.episode_source import ACTION, TIMES, EpisodeSource
from svfl_data.viewer.entities.fields import FieldView, curve_colors, field_views, log_range
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
    if prediction.actions is not None and not (shown.planar and prediction.action == ACTION):
        for view in field_views(shown):
            if view.path == prediction.action:
                _log_command(recording, view, t_ns, prediction.actions)
    elif prediction.actions is not None:
        for path, columns, labels, colors in (
            ("move", slice(1, 4), ["dx network", "dy network", "dz network"], names.PALE_AXES),
            ("turn", slice(4, 5), ["dtheta network"], [names.PALE_AXES[0]]),
            ("opening", slice(0, 1), ["opening network"], [names.PALE_AXES[1]]),
        ):
            lines = rr.SeriesLines(names=labels, colors=colors, widths=1.5, interpolation_mode="StepAfter")
            recording.log(f"{root}{names.PREDICTION}/{path}", lines, static=True)
            send_curve(recording, f"{root}{names.PREDICTION}/{path}", t_ns, prediction.actions[:, columns])


def network_view(view: FieldView) -> FieldView:
    """Return the view of a network's actions that belongs to a view of the recorded ones.

    Args:
        view: View of the recorded action.
    """
    words = tuple(f"{name} network" for name in view.names)
    return replace(view, entity=f"{view.entity}/{names.PREDICTION}", name=f"network: {view.name}", names=words)


def _log_command(recording: rr.RecordingStream, view: FieldView, t_ns: np.ndarray, actions: np.ndarray) -> None:
    """Log what a network would command, as thin curves in the colours of the recorded ones, or as a picture."""
    beside = network_view(view)
    if view.kind != "curves":  # too many components for curves
        values = actions.astype(np.float32).T
        log_range(recording, beside.entity, values)
        recording.log(beside.entity, rr.Tensor(values, dim_names=("component", "row")), static=True)
        return
    lines = rr.SeriesLines(names=beside.names, colors=curve_colors(view), widths=1.0, interpolation_mode="StepAfter")
    recording.log(beside.entity, lines, static=True)
    send_curve(recording, beside.entity, t_ns, actions[:, list(view.columns)])


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
