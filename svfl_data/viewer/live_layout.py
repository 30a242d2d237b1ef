"""Layout of the viewer's window for episodes that are being recorded."""

from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb

from svfl_data.system.printable import printable
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.fields import FieldView
from svfl_data.viewer.live_cameras import LiveCamera

BEHIND_S = 4.0
"""Time before the present that the plots show, [s]."""
MOST_FIELDS = 6
"""Largest number of plots of a robot's own fields that fit into the window; the others can be added in the viewer."""
WORDS = {"color": "colour", "depth": "depth"}


def arrange(
    cameras: Mapping[str, LiveCamera], fields: Sequence[FieldView], wrench: bool, planar: bool
) -> rrb.Blueprint:
    """Return the layout of the window for live episodes, which follows the clock and shows the last seconds.

    Args:
        cameras: Cameras by name.
        fields: Views of the robot's own fields.
        wrench: Whether the robot has the wrench sensor of ``streams/wrench``.
        planar: Whether its action is the planar one.
    """
    recent = rr.TimeRange(
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-BEHIND_S), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    curves = {"Force, N: x orange, y green, z blue": [names.FORCE_PLOT], "Torque, N m": [names.TORQUE_PLOT]}
    curves = curves if wrench else {}
    if planar:
        curves["Move, m: thick commanded, thin achieved"] = [names.COMMANDED, names.ACHIEVED]
    pictures = [
        rrb.Spatial2DView(origin=camera.entity, contents=[f"$origin/{kind}"], name=printable(f"{name}: {WORDS[kind]}"))
        for name, camera in cameras.items()
        for kind in camera.kinds
    ]
    lines: list[rrb.View] = [
        rrb.TimeSeriesView(
            contents=[f"+ {path}" for path in paths], name=name, axis_x=rrb.TimeAxis(view_range=recent),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, paths in curves.items()
    ]  # fmt: skip
    for view in fields[:MOST_FIELDS]:
        if view.kind == "curves":
            lines.append(rrb.TimeSeriesView(origin=view.entity, name=view.name, axis_x=rrb.TimeAxis(view_range=recent)))
        else:
            lines.append(rrb.TensorView(origin=view.entity, name=view.name))
    left: list[rrb.View | rrb.Container] = [rrb.Spatial3DView(origin=names.SCENE, name="Live")]
    left += [rrb.Horizontal(*pictures)] if pictures else []
    shares = [4] * len(lines) + [1]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[3, 2][: len(left)]),
            rrb.Vertical(*lines, rrb.TextDocumentView(origin=names.ABOUT, name="Now"), row_shares=shares),
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=names.TIMELINE, play_state="following"),
    )
