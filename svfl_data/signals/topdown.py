"""Recorded episodes and live frames from straight above; how that is drawn is told in `svfl_data.signals.top_view`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.errors import FieldError, UsageError
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.robot import Frame, Optics
from svfl_data.signals.top_view import EYE_M, SIZE, TopView


@dataclass(frozen=True, eq=False)
class TopDown:
    """Pictures from above.

    Attributes:
        color: (K, S, S, 3) uint8, black where nothing was seen; without K for a single step.
        depth: (K, S, S) uint16, in units of the view's `depth_scale`, down from its `eye`; 0 where nothing was seen.
        view: From where: scale, centre, axes.
    """

    color: np.ndarray
    depth: np.ndarray
    view: TopView

    @property
    def height_m(self) -> np.ndarray:
        """Base z of what is seen, shape of `depth`, [m]; NaN where nothing was seen."""
        return self.view.height_m(self.depth)


def topdown_frame(
    frame: Frame,
    calibration: Optics,
    workspace: np.ndarray,
    size: int = SIZE,
    extent: float | None = None,
    eye: float = EYE_M,
) -> tuple[np.ndarray, np.ndarray]:
    """The view from above of what a live camera sees, such as a `svfl_data.schema.robot.Frame` and its `Calibration`.

    Args:
        frame: Colour and depth.
        calibration: The camera's.
        workspace: Bounds of x, y, z in base, shape (3, 2), [m].
        size: Height and width of the result, [px].
        extent: Edge of the square that it shows, [m]; the wider side of the workspace by default.
        eye: Height from which depth is taken, base z, [m]; what is above it is not seen.

    Returns:
        Colour (size, size, 3) uint8, and depth (size, size) uint16 down from `eye` in the camera's own
        `depth_scale`; both 0 where nothing was seen.

    Raises:
        UsageError: If size or extent are not positive.
    """
    return TopView.over(workspace, calibration, size, extent, eye).draw([(frame, calibration)])


def topdown(
    episode: Episode,
    steps: int | Sequence[int] | None = None,
    cameras: Sequence[str] | None = None,
    size: int = SIZE,
    extent: float | None = None,
    eye: float = EYE_M,
) -> TopDown:
    """The view from above of a recorded episode, from the latest frame of each camera at or before an observation.

    Args:
        episode: Where to read.
        steps: Which observations, 0 .. N; one, several, or by default all.
        cameras: Which cameras see the scene together; all that have depth by default. The first gives the axes.
        size: Height and width of the result, [px].
        extent: Edge of the square that it shows, [m]; the wider side of the workspace by default.
        eye: Height from which depth is taken, base z, [m]; what is above it is not seen.

    Raises:
        UsageError: If there is no such camera or step, or size or extent are not positive.
        FieldError: If a camera has no depth.

    Example:
        >>> topdown(dataset[0], steps=-1 % 21, size=32).color.shape
        (32, 32, 3)
    """
    sources = _with_depth(episode, cameras)
    single = isinstance(steps, int | np.integer)
    wanted = list(range(len(episode.t_ns)) if steps is None else np.atleast_1d(steps))
    for step in wanted:
        if not 0 <= step < len(episode.t_ns):
            raise UsageError(f"{episode.name}: no step {step}; there are 0 to {len(episode.t_ns) - 1}")
    view = TopView.over(episode.workspace, sources[0], size, extent, eye)
    color = np.zeros((len(wanted), size, size, 3), np.uint8)
    depth = np.zeros((len(wanted), size, size), np.uint16)
    for out, step in enumerate(wanted):
        rows = [(camera, latest_frame(episode, camera, step)) for camera in sources]
        pictures = [(Frame(camera.color[row], camera.depth[row]), camera) for camera, row in rows if row is not None]
        if pictures:
            color[out], depth[out] = view.draw(pictures)
    return TopDown(color[0], depth[0], view) if single else TopDown(color, depth, view)


def latest_frame(episode: Episode, camera: Camera, step: int) -> int | None:
    """Row of a camera's latest frame at or before an observation, None if there is none yet."""
    rows = int(np.searchsorted(camera.t_ns, episode.t_ns[step], side="right"))
    return rows - 1 if rows else None


def _with_depth(episode: Episode, names: Sequence[str] | None) -> list[Camera]:
    known = episode.cameras
    deep = [name for name, camera in known.items() if camera.has("depth") and camera.has("depth_scale")]
    for name in names or ():
        if name not in known:
            raise UsageError(f"{episode.name}: no camera {name!r}; there are {', '.join(known) or 'none'}")
    lacking = sorted(set(names or ()) - set(deep))
    if lacking or not deep:
        who = f"camera {lacking[0]}" if lacking else "every camera"
        raise FieldError(f"{episode.name}: {who} was recorded without depth, which a view from above needs")
    return [known[name] for name in (names or deep)]
