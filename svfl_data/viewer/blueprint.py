"""Layout of the viewer's window: scene and images on the left, curves and text on the right."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from svfl_data.sampling.windows import WINDOW
from svfl_data.symmetry import element
from svfl_data.system.printable import printable
from svfl_data.viewer import names
from svfl_data.viewer.episode_source import ACTION, PROPRIO, TIMES, WRENCH_TIMES, EpisodeSource
from svfl_data.viewer.images import camera_entity, crop_range
from svfl_data.viewer.names import CAMERAS, SCENE, TIMELINE
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.recording import Summary

DARK = (22, 24, 28)
LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
NO_LEGEND = rrb.PlotLegend(visible=False)  # a legend of six curves would cover them; the title names them instead
COLORS = "x orange, y green, z blue"
EYE_DEG, DISTANCE = -75, 1.5
"""Position of the 3-D view's eye: its angle from the side of the camera (the lower edge of the image), [deg], and its
horizontal distance, in diagonals of the workspace."""
COMMANDED_AND_ACHIEVED = (("", "move"), ("_turn", "turn"), ("_opening", "opening"))


def one(shown: EpisodeSource, summary: Summary, prediction: Prediction | None = None) -> rrb.Blueprint:
    """Return the layout of the window for one episode, which is readable on a laptop screen (1440 x 850).

    Args:
        shown: Episode that is shown.
        summary: Ranges and annotations of the episode that were found while it was logged.
        prediction: Prediction of a network on the episode. None if no network is shown.

    Returns:
        Blueprint of the window, in which the time cursor starts at the end.
    """
    return _window(_page(shown, summary, prediction))


def side_by_side(episodes: Sequence[tuple[EpisodeSource, Summary, Prediction | None]]) -> rrb.Blueprint:
    """Return the layout for several episodes: one tab with all of them side by side, and one tab for each episode.

    Args:
        episodes: Episodes with the ranges found while they were logged, and the prediction of a network or None. All
            episodes are shown at the same time of their episode clocks.
    """
    columns = [
        rrb.Vertical(
            _scene(shown),
            rrb.Horizontal(*_pictures(shown, None)[:2]),
            _wrench(shown, names.FORCE_PLOT, f"Force, N: {COLORS}", summary.low[:3], summary.high[:3]),
            _wrench(shown, names.TORQUE_PLOT, "Torque, N m", summary.low[3:], summary.high[3:]),
            row_shares=[5, 3, 3, 3],
            name=_title(shown),
        )
        for shown, summary, _ in episodes
    ]
    pages = [_page(shown, summary, prediction) for shown, summary, prediction in episodes]
    return _window(rrb.Tabs(rrb.Horizontal(*columns, name="Side by side"), *pages, active_tab=0))


def _window(content: rrb.Container) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
    )


def _title(shown: EpisodeSource) -> str:
    return printable(f"{shown.meta.task} {shown.meta.index}")


def _page(shown: EpisodeSource, summary: Summary, prediction: Prediction | None) -> rrb.Container:
    low, high, root = summary.low, summary.high, shown.root
    size_low, size_high = np.zeros(1), np.array([summary.peak])
    force = rrb.Tabs(
        _wrench(shown, names.FORCE_PLOT, f"Force, N: {COLORS}; bars: contact, labels", low[:3], high[:3]),
        _plot(shown, [names.SIZE], "|Force| filtered, N", size_low, size_high),
        _plot(shown, [names.RAW_FORCE], "Raw force, N"),
    )
    torque = rrb.Tabs(
        _wrench(shown, names.TORQUE_PLOT, f"Torque, N m: {COLORS}", low[3:], high[3:]),
        _plot(shown, [names.RAW_TORQUE], "Raw torque, N m"),
    )
    about = rrb.TextDocumentView(origin=root + names.ABOUT, name="About this episode")
    return rrb.Horizontal(
        rrb.Vertical(_scene(shown), rrb.Horizontal(*_pictures(shown, prediction)), row_shares=[3, 2]),
        rrb.Vertical(force, torque, rrb.Tabs(*_motion(shown, prediction)), about, row_shares=[6, 5, 5, 6]),
        column_shares=[1, 1],
        name=_title(shown),
    )


def _motion(shown: EpisodeSource, prediction: Prediction | None) -> list[rrb.View | rrb.Container]:
    action = shown[ACTION]
    thinks = [f"{names.PREDICTION}/{name}" for _, name in COMMANDED_AND_ACHIEVED]
    if prediction is None or prediction.actions is None:
        thinks = ["", "", ""]
    moves, turn, opening = (
        [path for path in (names.COMMANDED + suffix, names.ACHIEVED + suffix, thought) if path]
        for (suffix, _), thought in zip(COMMANDED_AND_ACHIEVED, thinks, strict=True)
    )
    tabs: list[rrb.View | rrb.Container] = [
        rrb.Horizontal(
            _plot(shown, moves, "Move, m", *_low_high(action[:, 1:4]), legend=NO_LEGEND),
            _plot(shown, turn, "Turn, rad", *_low_high(action[:, 4:]), legend=NO_LEGEND),
            _plot(shown, opening, "Gripper, 0 to 1", np.zeros(1), np.ones(1), legend=NO_LEGEND),
            name="Action: thick commanded, thin achieved",
        ),
        rrb.Horizontal(
            _plot(shown, [names.POSITION], "TCP position, m", *_low_high(shown[PROPRIO][:, 1:4])),
            _plot(shown, [names.OPENING_AND_YAW], "Gripper opening, yaw", *_low_high(shown[PROPRIO][:, [0, 4]])),
            name="Proprio",
        ),
        _plot(shown, [names.REWARD], "Reward and success", np.zeros(1), np.ones(1)),
    ]
    if prediction is not None and prediction.probabilities is not None:
        path = f"{names.PREDICTION}/probability"
        tabs.insert(0, _plot(shown, [path], "Network: probability of each direction", np.zeros(1), np.ones(1)))
    return tabs


def _pictures(shown: EpisodeSource, prediction: Prediction | None) -> list[rrb.View]:
    views: list[rrb.View] = []
    for camera in shown.cameras:
        entity = camera_entity(shown.root, camera)
        outline = (
            "seen" if prediction is not None and prediction.crop is not None and prediction.camera == camera else "crop"
        )
        contents = ["$origin/color", f"$origin/{outline}", "$origin/predicted", "$origin/true"]
        views.append(rrb.Spatial2DView(origin=entity, contents=contents, name=printable(f"{camera}: colour")))
        if f"cameras/{camera}/depth" in shown:
            views.append(
                rrb.Spatial2DView(origin=entity, contents=["$origin/depth"], name=printable(f"{camera}: depth, m"))
            )
    if prediction is not None and prediction.seen is not None:
        views.append(rrb.Spatial2DView(origin=f"{shown.root}{names.PREDICTION}/seen", name="What the network sees"))
    elif shown.cameras:
        camera = shown.cameras[0]
        height, width = shown.arrays[f"cameras/{camera}/color"].shape[1:3]
        bounds = rrb.VisualBounds2D(x_range=crop_range(width), y_range=crop_range(height))
        name, entity = "Crop that networks see", camera_entity(shown.root, camera)
        views.append(rrb.Spatial2DView(origin=entity, contents=["$origin/color"], name=name, visual_bounds=bounds))
    return views


def _scene(shown: EpisodeSource) -> rrb.Spatial3DView:
    """Return the 3-D view, seen from the side of the image's lower edge, so that right in the image is right in it."""
    workspace = shown["workspace"]
    target = np.array([*workspace[:2].mean(axis=1), 0.2])
    axes = next((shown[f"cameras/{camera}/image_axes"] for camera in shown.cameras), np.eye(2))
    towards_eye = element(EYE_DEG) @ axes.T @ [0.0, -1.0]
    reach = float(np.linalg.norm(np.ptp(workspace, axis=1)))
    eye = target + DISTANCE * reach * np.array([*towards_eye, 0.5])
    scene = shown.root + SCENE
    flat = [
        f"- {shown.root}{CAMERAS}/{camera}/{name}"
        for camera in shown.cameras
        for name in ("crop", "seen", "predicted", "true")
    ]
    return rrb.Spatial3DView(
        origin=scene,
        contents=["$origin/**", *flat],
        name=f"Scene in base axes: {_title(shown)}",
        background=DARK,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def _wrench(shown: EpisodeSource, path: str, name: str, low: np.ndarray, high: np.ndarray) -> rrb.TimeSeriesView:
    """Return a plot of the processed wrench, with the annotations below and a thick curve for the current window."""
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
    return _plot(shown, [path, window, *marks], name, low, high, NO_LEGEND, override)


def _plot(
    shown: EpisodeSource,
    paths: Sequence[str],
    name: str,
    low: np.ndarray | None = None,
    high: np.ndarray | None = None,
    legend: rrb.PlotLegend = LEGEND,
    overrides: dict[str, rrb.VisibleTimeRanges] | None = None,
) -> rrb.TimeSeriesView:
    """Return a plot over the whole episode."""
    clocks = [shown[path] for path in (TIMES, WRENCH_TIMES) if len(shown.arrays[path])]
    start, end = min(t[0] for t in clocks) / 1e9, max(t[-1] for t in clocks) / 1e9
    whole = rr.TimeRange(
        start=rrb.TimeRangeBoundary.absolute(seconds=float(start)),
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


def _low_high(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
