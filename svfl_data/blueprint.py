"""How the viewer's window is arranged: scene and images on the left, plots and text on the right."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from svfl_data.episode import Camera, Episode
from svfl_data.symmetry import element

TIMELINE = "time"
"""The one timeline: seconds of the episode clock."""

SCENE, CAMERAS, WRENCH, ACTION, ABOUT = "scene", "scene/cameras", "wrench", "action", "about"
"""Entity paths. Everything below SCENE is in base axes, in metres."""

DARK = (22, 24, 28)


def arrange(episode: Episode) -> rrb.Blueprint:
    """The window for an episode, readable at first sight on a screen of 1920 x 1080.

    Args:
        episode: Its workspace decides where the eye of the 3-D view is, its readings the ranges of the plots.

    Returns:
        The blueprint; the time cursor starts at the end, where the collision is.
    """
    force, torque = np.split(episode.tared_wrench, 2, axis=1)
    displacement, rest = episode.action[:, 1:4], episode.action[:, [0, 4]]
    plots = {
        "force": _plot(episode, f"{WRENCH}/force", "Force on the hand, N (base axes, tared)", force),
        "torque": _plot(episode, f"{WRENCH}/torque", "Torque on the hand, N m (about the sensor, tared)", torque),
        "move": _plot(episode, f"{ACTION}/displacement", "Action: TCP displacement, m", displacement, 0.6),
        "rest": _plot(episode, f"{ACTION}/opening_and_turn", "Action: gripper, yaw change", rest, 0.6),
    }
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _scene(episode),
                rrb.Horizontal(*(view for camera in episode.cameras.values() for view in _images(camera))),
                row_shares=[3, 2],
            ),
            rrb.Vertical(
                plots["force"],
                plots["torque"],
                rrb.Horizontal(plots["move"], plots["rest"]),
                rrb.TextDocumentView(origin=ABOUT, name="About this episode"),
                row_shares=[5, 5, 5, 6],
            ),
            column_shares=[1, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
    )


def _images(camera: Camera) -> list[rrb.Spatial2DView]:
    views = [rrb.Spatial2DView(origin=f"{CAMERAS}/{camera.name}/color", name=f"Camera {camera.name}: colour")]
    if camera.has("depth"):
        depth = rrb.Spatial2DView(origin=f"{CAMERAS}/{camera.name}/depth", name=f"Camera {camera.name}: depth, m")
        views.append(depth)
    return views


def _scene(episode: Episode) -> rrb.Spatial3DView:
    """Seen from where the image's lower edge is, so that right in the image is right in the scene too."""
    target = np.array([*episode.centre, 0.1])
    axes = next((camera.image_axes for camera in episode.cameras.values()), np.eye(2))
    towards_eye = element(-30) @ axes.T @ [0.0, -1.0]
    reach = float(np.linalg.norm(np.ptp(episode.workspace, axis=1)))
    eye = target + 0.93 * reach * np.array([*towards_eye, 0.6])
    return rrb.Spatial3DView(
        origin=SCENE,
        contents=["$origin/**", *(f"- {CAMERAS}/{camera}/depth" for camera in episode.cameras)],
        name="Scene in base axes",
        background=DARK,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def _plot(episode: Episode, path: str, name: str, values: np.ndarray, headroom: float = 0.1) -> rrb.TimeSeriesView:
    """A plot over the whole episode; `headroom` is the room above the lines, for the legend."""
    times = np.concatenate([episode.t_ns, episode.wrench_t_ns]) / 1e9
    whole = rr.TimeRange(
        start=rrb.TimeRangeBoundary.absolute(seconds=float(times.min())),
        end=rrb.TimeRangeBoundary.absolute(seconds=float(times.max() + 0.02 * np.ptp(times))),
    )
    return rrb.TimeSeriesView(
        origin=path,
        name=name,
        axis_x=rrb.TimeAxis(view_range=whole),
        axis_y=rrb.ScalarAxis(range=axis_range(values, headroom)),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
    )


def axis_range(values: np.ndarray, headroom: float = 0.1) -> tuple[float, float]:
    """Range of a plot's vertical axis.

    Args:
        values: What is plotted, any shape, possibly empty.
        headroom: Room above, as a fraction of the values' span; below there is a tenth.

    Returns:
        Lower and upper end, with at least one number beside 0 written at the axis: Rerun writes multiples of a power
        of ten only, and only of those that are more than about a ninth of the range.
    """
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    span = high - low or 1.0
    low, high = low - 0.1 * span, high + headroom * span
    step = 10.0 ** np.ceil(np.log10((high - low) / 9))
    return (low, 1.1 * step) if -step < low < 0 < high < step else (low, high)
