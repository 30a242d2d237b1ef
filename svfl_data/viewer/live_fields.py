"""What a robot records beyond the paper's fields, in the live display: curves, and pictures of larger rows."""

from collections.abc import Iterator

import numpy as np
import rerun as rr

from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.field import Field
from svfl_data.schema.robot import Observation, Readings
from svfl_data.viewer.entities.episode_source import WRENCH
from svfl_data.viewer.entities.fields import FieldView, log_curve_style, tiled, views_of
from svfl_data.viewer.entities.names import send
from svfl_data.viewer.entities.plots import send_curve

DRAWN = ("cameras/", "streams/tcp/", "streams/object/", "streams/joints/")
"""Groups that have a drawing of their own, or are too many curves to read while a robot moves."""


class LiveFields:
    """Rows of the robot's own fields, which wait to be sent.

    Args:
        recording: Recording to log to.
        declarations: Declarations of what the robot records.
        action: Declaration of the action if it is drawn as curves, None if it has a drawing of its own.
        seen: First observation.
        readings: First readings.

    Attributes:
        views: Views of the fields, for the layout of the window.
    """

    def __init__(
        self, recording: rr.RecordingStream, declarations: Declarations, action: Field | None, seen: Observation,
        readings: Readings,
    ) -> None:  # fmt: skip
        declared = dict(_declared(declarations, seen, readings)) | ({ACTION: action} if action else {})
        rows = {path: values.shape[1:] for path, _, values in _rows(seen, readings)}
        rows |= {ACTION: tuple(size for size in action.shape[1:] if isinstance(size, int))} if action else {}
        self.views: list[FieldView] = []
        for path, field in declared.items():
            self.views += [one for one in views_of(field, path, rows[path]) if one.kind in ("curves", "pictures")]
        for view in self.views:
            if view.kind == "curves":
                log_curve_style(recording, view)
        self._paths = {view.path for view in self.views}
        self._waiting: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {path: [] for path in self._paths}

    def begin(self, t_ns: int) -> None:
        """Interrupt all curves, because another episode begins.

        Args:
            t_ns: Time of the interruption on the recording's clock, [ns].
        """
        widths: dict[str, int] = {}
        for view in self.views:
            if view.kind == "curves":
                widths[view.path] = max(widths.get(view.path, 0), *(column + 1 for column in view.columns))
        for path, width in widths.items():
            self._waiting[path].append((np.array([t_ns]), np.full((1, width), np.nan)))

    def add(self, begin_ns: int, seen: Observation, action: np.ndarray | None, before_ns: int, now: Readings) -> None:
        """Keep the rows of a step until they are sent.

        Args:
            begin_ns: Begin of the episode on the recording's clock, [ns].
            seen: Observation.
            action: Action that led to it; None at the first observation.
            before_ns: Time of the observation before the action, [ns] of the recording's clock.
            now: Readings since the observation before.
        """
        for path, t_ns, values in _rows(seen, now):
            if path in self._paths and len(values):
                self._waiting[path].append((t_ns + begin_ns, values))
        if action is not None and ACTION in self._paths:
            self._waiting[ACTION].append((np.array([before_ns]), action[None]))

    def send(self, recording: rr.RecordingStream) -> None:
        """Send all rows that wait: curves whole, of pictures the latest."""
        for view in self.views:
            rows = self._waiting[view.path]
            if not rows:
                continue
            if view.kind == "pictures":
                t_ns, values = rows[-1]
                picture = tiled(values[-1]).astype(np.float32)
                send(recording, view.entity, t_ns[-1:], rr.Tensor.columns(data=picture))
                continue
            t_ns = np.concatenate([times for times, _ in rows])
            flat = np.concatenate([values.reshape(len(values), -1).astype(np.float64) for _, values in rows])
            send_curve(recording, view.entity, t_ns, flat[:, list(view.columns)])
        self._waiting = {path: [] for path in self._paths}


def _rows(seen: Observation, readings: Readings) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield path, times and rows of everything that has no drawing of its own."""
    now = np.array([seen.t_ns], np.int64)
    for group, columns in readings.items():
        for name, values in columns.items():
            if name != "t_ns" and not f"{group}/".startswith(DRAWN) and f"{group}/{name}" != WRENCH:
                yield f"{group}/{name}", columns["t_ns"], values
    for path, values in seen.values.items():
        if path.startswith("observations/"):
            yield path, now, np.asarray(values)[None]


def _declared(declarations: Declarations, seen: Observation, readings: Readings) -> Iterator[tuple[str, Field]]:
    for path, _, values in _rows(seen, readings):
        field = declarations.at(path)
        if field is not None and values.dtype.kind in "biuf":
            yield path, field
