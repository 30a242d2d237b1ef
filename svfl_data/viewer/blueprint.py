"""Layout of the viewer's window: scene and images on the left, curves and text on the right."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from svfl_data.schema.action_fields import EXPERT_ACTION
from svfl_data.schema.field_words import is_wrench
from svfl_data.system.printable import printable
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.episode_source import ACTION, PROPRIO, WRENCH, EpisodeSource
from svfl_data.viewer.entities.fields import FieldView
from svfl_data.viewer.entities.names import TIMELINE
from svfl_data.viewer.overlay import network_view
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.recording import Summary
from svfl_data.viewer.views import (
    COLORS,
    FEW_CURVES,
    NO_LEGEND,
    episode_title,
    field_view,
    has_scene,
    low_high,
    pictures,
    plot,
    scene_view,
    wrench_plot,
)

COMMANDED_AND_ACHIEVED = (("", "move"), ("_turn", "turn"), ("_opening", "opening"))


def one(shown: EpisodeSource, summary: Summary, prediction: Prediction | None = None) -> rrb.Blueprint:
    """Return the layout of the window for one episode, which is readable on a laptop screen (1440 x 850).

    Args:
        shown: Episode that is shown.
        summary: What was found while the episode was logged: ranges, annotations, further views.
        prediction: Prediction of a network on the episode. None if no network is shown.

    Returns:
        Blueprint of the window, in which the time cursor starts at the end.
    """
    pages = _pages(shown, summary, prediction)
    return _window(pages[0] if len(pages) == 1 else rrb.Tabs(*pages, active_tab=0))


def side_by_side(episodes: Sequence[tuple[EpisodeSource, Summary, Prediction | None]]) -> rrb.Blueprint:
    """Return the layout for several episodes: one tab with all of them side by side, and one tab for each episode.

    Args:
        episodes: Episodes with what was found while they were logged, and the prediction of a network or None. All
            episodes are shown at the same time of their episode clocks.
    """
    columns = []
    for shown, summary, _ in episodes:
        low, high = summary.loads.low, summary.loads.high
        seen = pictures(shown, None)[:2]
        rows: list[tuple[int, rrb.View | rrb.Container]] = [(5, scene_view(shown))] if has_scene(shown) else []
        rows += [(3, rrb.Horizontal(*seen))] if seen else []
        if WRENCH in shown:
            rows += [
                (3, wrench_plot(shown, names.FORCE_PLOT, f"Force, N: {COLORS}", low[:3], high[:3])),
                (3, wrench_plot(shown, names.TORQUE_PLOT, "Torque, N m", low[3:], high[3:])),
            ]
        rows += [(3, view) for view in _motion(shown, summary, None)[: 0 if WRENCH in shown else 2]]
        shares = [share for share, _ in rows]
        columns.append(rrb.Vertical(*(view for _, view in rows), row_shares=shares, name=episode_title(shown)))
    pages = [page for shown, summary, prediction in episodes for page in _pages(shown, summary, prediction)]
    return _window(rrb.Tabs(rrb.Horizontal(*columns, name="Side by side"), *pages, active_tab=0))


def _window(content: rrb.Container) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
    )


def _pages(shown: EpisodeSource, summary: Summary, prediction: Prediction | None) -> list[rrb.Container]:
    """Return the page of an episode and, if it has fields without a drawing of their own, a page of these."""
    pages: list[rrb.Container] = [_page(shown, summary, prediction)]
    if further := [view for view in summary.views if not _of_first_page(shown, view)]:
        views = [field_view(shown, view) for view in further]
        words = f"{len(views)} further plot{'s' if len(views) > 1 else ''}"
        pages.append(rrb.Grid(*views, name=f"{episode_title(shown)}: {words}"))
    return pages


def _of_first_page(shown: EpisodeSource, view: FieldView) -> bool:
    """Return whether a view is on the page of the episode: those of commands and wrenches."""
    return _is_command(view) or is_wrench(shown.declarations.at(view.path))


def _is_command(view: FieldView) -> bool:
    return view.path.startswith("actions/") and view.path != EXPERT_ACTION


def _page(shown: EpisodeSource, summary: Summary, prediction: Prediction | None) -> rrb.Container:
    about = rrb.TextDocumentView(origin=shown.root + names.ABOUT, name="About this episode")
    right = _loads(shown, summary)
    right += [(5, rrb.Tabs(*_motion(shown, summary, prediction))), (6, about)]
    left: list[tuple[int, rrb.View | rrb.Container]] = [(3, scene_view(shown))] if has_scene(shown) else []
    if seen := pictures(shown, prediction):
        left.append((2, rrb.Horizontal(*seen)))
    columns = [
        rrb.Vertical(*(view for _, view in column), row_shares=[share for share, _ in column])
        for column in (left, right)
        if column
    ]
    return rrb.Horizontal(*columns, column_shares=[1] * len(columns), name=episode_title(shown))


def _loads(shown: EpisodeSource, summary: Summary) -> list[tuple[int, rrb.View | rrb.Container]]:
    """Return the plots of all wrenches with their shares of the height, those of ``streams/wrench`` first."""
    low, high = summary.loads.low, summary.loads.high
    tabs: list[list[rrb.View]] = [[], []]
    if WRENCH in shown:
        size_low, size_high = np.zeros(1), np.array([summary.loads.peak])
        tabs[0] += [
            wrench_plot(shown, names.FORCE_PLOT, f"Force, N: {COLORS}; bars: contact, labels", low[:3], high[:3]),
            plot(shown, [names.SIZE], "|Force| filtered, N", size_low, size_high),
            plot(shown, [names.RAW_FORCE], "Raw force, N"),
        ]
        tabs[1] += [
            wrench_plot(shown, names.TORQUE_PLOT, f"Torque, N m: {COLORS}", low[3:], high[3:]),
            plot(shown, [names.RAW_TORQUE], "Raw torque, N m"),
        ]
    for view in summary.views:
        if is_wrench(shown.declarations.at(view.path)):
            tabs[view.columns[0] // 3].append(field_view(shown, view))
    return [(share, rrb.Tabs(*found)) for share, found in zip((6, 5), tabs, strict=True) if found]


def _motion(shown: EpisodeSource, summary: Summary, prediction: Prediction | None) -> list[rrb.View | rrb.Container]:
    tabs: list[rrb.View | rrb.Container] = [_planar(shown, prediction)] if shown.planar else []
    predicted = prediction.action if prediction is not None and prediction.actions is not None else ""
    commanded: dict[str, list[rrb.View]] = {}
    for view in summary.views:
        if _is_command(view):
            beside = network_view(view) if view.path == predicted else None
            plots = commanded.setdefault(view.path, [])
            plots.append(field_view(shown, view, narrow=len(view.columns) <= FEW_CURVES, beside=beside))
            if beside and view.kind != "curves":
                plots.append(field_view(shown, beside))
    for path, views in commanded.items():
        name = "Action" if path == ACTION else f"Action {path.removeprefix('actions/')}"
        how = "thick commanded, thin the network's" if path == predicted else "commanded"
        tabs.append(rrb.Horizontal(*views, name=printable(f"{name}: {how}")))
    if WRENCH not in shown and summary.loads.annotations:
        tabs.append(plot(shown, [f"{names.MARKS}/**"], "Annotations"))
    if PROPRIO in shown:
        proprio = shown[PROPRIO]
        tabs.append(
            rrb.Horizontal(
                plot(shown, [names.POSITION], "TCP position, m", *low_high(proprio[:, 1:4])),
                plot(shown, [names.OPENING_AND_YAW], "Gripper opening, yaw", *low_high(proprio[:, [0, 4]])),
                name="Proprio",
            )
        )
    tabs.append(plot(shown, [names.REWARD], "Reward and success", np.zeros(1), np.ones(1)))
    if prediction is not None and prediction.probabilities is not None:
        path = f"{names.PREDICTION}/probability"
        tabs.insert(0, plot(shown, [path], "Network: probability of each direction", np.zeros(1), np.ones(1)))
    return tabs


def _planar(shown: EpisodeSource, prediction: Prediction | None) -> rrb.Container:
    action = shown[ACTION]
    predictions = [f"{names.PREDICTION}/{name}" for _, name in COMMANDED_AND_ACHIEVED]
    if prediction is None or prediction.actions is None:
        predictions = ["", "", ""]
    moves, turn, opening = (
        [path for path in (names.COMMANDED + suffix, names.ACHIEVED + suffix, predicted) if path]
        for (suffix, _), predicted in zip(COMMANDED_AND_ACHIEVED, predictions, strict=True)
    )
    return rrb.Horizontal(
        plot(shown, moves, "Move, m", *low_high(action[:, 1:4]), legend=NO_LEGEND),
        plot(shown, turn, "Turn, rad", *low_high(action[:, 4:]), legend=NO_LEGEND),
        plot(shown, opening, "Gripper, 0 to 1", np.zeros(1), np.ones(1), legend=NO_LEGEND),
        name="Action: thick commanded, thin achieved",
    )
