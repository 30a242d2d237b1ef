"""The single views of the viewer's window: the 3-D scene, pictures, and plots over the whole episode."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.field_words import camera_pose
from svfl_data.symmetry import element
from svfl_data.system.printable import printable
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.cameras import image_entity
from svfl_data.viewer.entities.episode_source import WRENCH_TIMES, EpisodeSource
from svfl_data.viewer.entities.fields import FieldView
from svfl_data.viewer.entities.images import crop_range
from svfl_data.viewer.entities.names import CAMERAS, SCENE, TIMELINE
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.recording import JOINTS

DARK = (22, 24, 28)
LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
NO_LEGEND = rrb.PlotLegend(visible=False)  # a legend of six curves would cover them; the title names them instead
LEGEND_ROOM, FEW_CURVES = 0.4, 3
"""Room for the legend of a plot, as a share of the episode's time, and the number of curves up to which the title of a
narrow plot can name them."""
COLORS = "x orange, y green, z blue"
EYE_DEG, DISTANCE = -75, 1.5
"""Position of the 3-D view's eye: its angle from the side of the camera (the lower edge of the image), [deg], and its
horizontal distance, in diagonals of the workspace."""
UNKNOWN_ROOM, MARGIN_M = np.array([[0.2, 0.8], [-0.3, 0.3], [0.0, 0.4]]), 0.2
"""What the 3-D view shows if there is no workspace and the path of the TCP is unknown, and the margin around the TCP's
way, [m]."""
IMAGES = {"color": "colour", "depth": "depth, m", "grey": "grey", "grey16": "grey, 16 bits"}


def scene_view(shown: EpisodeSource) -> rrb.Spatial3DView:
    """Return the 3-D view, seen from the side of the image's lower edge, so that right in the image is right in it.

    Args:
        shown: Episode that is shown.
    """
    room = _room(shown)
    target = np.array([*room[:2].mean(axis=1), 0.2 if "workspace" in shown else room[2].mean()])
    turned = [shown[path] for camera in shown.cameras if (path := f"cameras/{camera}/image_axes") in shown]
    axes = turned[0] if turned else np.eye(2)
    towards_eye = element(EYE_DEG) @ axes.T @ [0.0, -1.0]
    reach = float(np.linalg.norm(np.ptp(room, axis=1)))
    eye = target + DISTANCE * reach * np.array([*towards_eye, 0.5])
    scene = shown.root + SCENE
    flat = [
        f"- {shown.root}{CAMERAS}/{camera}/{name}"
        for camera in shown.cameras
        if shown.placed(camera)
        for name in ("crop", "seen", "predicted", "true")
    ]
    return rrb.Spatial3DView(
        origin=scene,
        contents=["$origin/**", *flat],
        name=f"Scene in base axes: {episode_title(shown)}",
        background=DARK,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def has_scene(shown: EpisodeSource) -> bool:
    """Return whether anything is known that has a place in the 3-D scene.

    Args:
        shown: Episode that is shown.
    """
    known = ("workspace", "streams/object/pose", JOINTS)
    placed = any(path in shown for path in known) or any(map(shown.placed, shown.cameras))
    return placed or shown.positions() is not None


def _room(shown: EpisodeSource) -> np.ndarray:
    """Return the bounds of what the 3-D view shows, shape (3, 2), [m]: the workspace, or where the TCP goes."""
    if "workspace" in shown:
        return shown["workspace"]
    way = shown.positions()
    if way is None or not len(way[1]):
        return UNKNOWN_ROOM
    around = np.stack([way[1].min(axis=0) - MARGIN_M, way[1].max(axis=0) + MARGIN_M], axis=1)
    return np.asarray(around, dtype=np.float64)


def pictures(shown: EpisodeSource, prediction: Prediction | None) -> list[rrb.View]:
    """Return the views of all images of the cameras, and of what networks see.

    Args:
        shown: Episode that is shown.
        prediction: Prediction of a network on the episode. None if no network is shown.
    """
    views: list[rrb.View] = []
    for camera in shown.cameras:
        entity = shown.camera_entity(camera)
        outline = (
            "seen" if prediction is not None and prediction.crop is not None and prediction.camera == camera else "crop"
        )
        drawn = [f"$origin/{outline}", "$origin/predicted", "$origin/true"]
        pose = camera_pose(camera, shown.arrays)
        where = f" ({pose if shown.placed(camera) or pose == 'no pose' else 'pose unknown'})" if pose else ""
        for path in shown.declarations.image_paths(camera, shown.arrays):
            kind = path.rpartition("/")[2]
            contents = [f"+ {image_entity(shown, path)}", *(drawn if kind == "color" else [])]
            name = f"{camera}: {IMAGES.get(kind, kind)}{where if kind != 'depth' else ''}"
            views.append(rrb.Spatial2DView(origin=entity, contents=contents, name=printable(name)))
    if prediction is not None and prediction.seen is not None:
        views.append(rrb.Spatial2DView(origin=f"{shown.root}{names.PREDICTION}/seen", name="What the network sees"))
    elif seen := [camera for camera in shown.cameras if f"cameras/{camera}/color" in shown]:
        height, width = shown.arrays[f"cameras/{seen[0]}/color"].shape[1:3]
        bounds = rrb.VisualBounds2D(x_range=crop_range(width), y_range=crop_range(height))
        name, entity = "Crop that networks see", shown.camera_entity(seen[0])
        views.append(rrb.Spatial2DView(origin=entity, contents=["$origin/color"], name=name, visual_bounds=bounds))
    return views


def wrench_plot(shown: EpisodeSource, path: str, name: str, low: np.ndarray, high: np.ndarray) -> rrb.TimeSeriesView:
    """Return a plot of the processed wrench, with the annotations below and a thick curve for the current window.

    Args:
        shown: Episode that is shown, which has ``streams/wrench``.
        path: Entity of the force or of the torque.
        name: Title of the plot.
        low: Smallest value of each component, shape (3,).
        high: Largest value of each component, shape (3,).
    """
    window = {names.FORCE_PLOT: names.WINDOW_FORCE, names.TORQUE_PLOT: names.WINDOW_TORQUE}[path]
    marks = [f"{names.MARKS}/**"] if path == names.FORCE_PLOT else []
    clock = shown[WRENCH_TIMES]
    step_s = float(np.median(np.diff(clock))) / 1e9 if len(clock) > 1 else 0.0
    last = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-(WINDOW - 0.5) * step_s),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    override = {f"{shown.root}{window}": last}
    return plot(shown, [path, window, *marks], name, low, high, NO_LEGEND, override)


def field_view(
    shown: EpisodeSource, view: FieldView, narrow: bool = False, beside: FieldView | None = None
) -> rrb.View:
    """Return the view of a field that has no drawing of its own.

    Args:
        shown: Episode that is shown.
        view: What is drawn of the field, and where it was logged.
        narrow: Whether the plot has no room for a legend; the title then names the curves, in the order of their
            colours.
        beside: Further view whose curves are drawn in the same plot; None if there is none.
    """
    if view.kind == "curves":
        paths = [one.entity.removeprefix(shown.root) for one in (view, beside) if one]
        if narrow and view.names:
            units = {name.partition(", ")[2] for name in view.names} - {""}
            names_ = ", ".join(name.partition(", ")[0] for name in view.names)
            return plot(shown, paths, ", ".join([names_, *sorted(units)]), legend=NO_LEGEND)
        return plot(shown, paths, view.name, room=LEGEND_ROOM if len(view.names) > 1 else 0.0)
    if view.kind == "text":
        columns = rrb.TextLogColumns(text_log_columns=["body"])
        return rrb.TextLogView(origin=view.entity, name=view.name, columns=columns)
    if view.kind == "images":
        return rrb.Spatial2DView(origin=view.entity, name=view.name)
    mapping = rrb.TensorScalarMapping(colormap="viridis", mag_filter="nearest")
    name = f"{view.name}: components over all rows" if view.kind == "map" else view.name
    fit: Literal["fill", "fillkeepaspectratio"] = "fill" if view.kind == "map" else "fillkeepaspectratio"
    return rrb.TensorView(origin=view.entity, name=name, scalar_mapping=mapping, view_fit=fit)


def plot(
    shown: EpisodeSource,
    paths: Sequence[str],
    name: str,
    low: np.ndarray | None = None,
    high: np.ndarray | None = None,
    legend: rrb.PlotLegend = LEGEND,
    overrides: dict[str, rrb.VisibleTimeRanges] | None = None,
    room: float = 0.0,
) -> rrb.TimeSeriesView:
    """Return a plot over the whole episode.

    Args:
        shown: Episode that is shown.
        paths: Entities of the curves, without the prefix of the episode.
        name: Title of the plot.
        low: Smallest value of each curve. None to leave the range to the viewer.
        high: Largest value of each curve.
        legend: Where the legend is.
        overrides: Time ranges of single entities.
        room: Room for a legend on the left, as a share of the episode's time.
    """
    start, end = (t_ns / 1e9 for t_ns in shown.span_ns)
    whole = rr.TimeRange(
        start=rrb.TimeRangeBoundary.absolute(seconds=float(start - room * (end - start))),
        end=rrb.TimeRangeBoundary.absolute(seconds=float(end + 0.02 * (end - start))),
    )
    vertical = None if low is None or high is None else rrb.ScalarAxis(range=axis_range(low.min(), high.max()))
    return rrb.TimeSeriesView(
        contents=[f"+ {shown.root}{path}" for path in paths],
        name=name,
        axis_x=rrb.TimeAxis(view_range=whole),
        axis_y=vertical,
        plot_legend=legend,
        overrides=overrides,  # type: ignore[arg-type] # the annotation of overrides lacks archetypes
    )


def low_high(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return smallest and largest of some values, both of at least one axis; zeros if there are no values."""
    return (values.min(keepdims=True), values.max(keepdims=True)) if values.size else (np.zeros(1), np.zeros(1))


def axis_range(low: float, high: float) -> tuple[float, float]:
    """Return the range of the vertical axis of a plot, such that Rerun labels at least one number besides 0.

    Rerun labels only multiples of a power of ten that is larger than about a ninth of the range.

    Args:
        low: Smallest value in the plot.
        high: Largest value in the plot.

    Returns:
        Lower and upper end of the axis.
    """
    span = high - low or 1.0
    low, high = float(low - 0.1 * span), float(high + 0.1 * span)
    step = 10.0 ** np.ceil(np.log10((high - low) / 9))
    return (low, 1.1 * step) if -step < low < 0 < high < step else (low, high)


def episode_title(shown: EpisodeSource) -> str:
    """Return task and number of an episode."""
    return printable(f"{shown.meta.task} {shown.meta.index}")
