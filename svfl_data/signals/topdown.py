"""Views from straight above of recorded episodes and live frames, drawn by `svfl_data.signals.top_view`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.errors import FieldError, UsageError
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.robot import Frame, Optics
from svfl_data.signals.top_view import EYE_M, SIZE, TopView


@dataclass(frozen=True, eq=False)
class TopDown:
    """Views from straight above, and the geometry that they share.

    Attributes:
        color: Colour images, shape (K, S, S, 3), uint8, black where nothing was seen. The shape is (S, S, 3) for a
            single step.
        depth: Depth images, shape (K, S, S), uint16, down from the `eye` of the view in units of its `depth_scale`; 0
            where nothing was seen. The shape is (S, S) for a single step.
        view: Geometry of the images: scale, centre and axes.
    """

    color: np.ndarray
    depth: np.ndarray
    view: TopView

    @property
    def height_m(self) -> np.ndarray:
        """Base z of the surfaces that the images show, shape of `depth`, [m]; NaN where nothing was seen."""
        return self.view.height_m(self.depth)


def topdown_frame(
    frame: Frame,
    calibration: Optics,
    workspace: np.ndarray,
    size: int = SIZE,
    extent: float | None = None,
    eye: float = EYE_M,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the view from straight above of what a live camera sees.

    Args:
        frame: Colour image and depth image of the camera.
        calibration: Geometry of the camera, such as a `svfl_data.schema.robot.Calibration`.
        workspace: Bounds of x, y, z in base, shape (3, 2), [m].
        size: Height and width of the view, [px].
        extent: Edge of the square that the view shows, [m]. The wider side of the workspace by default.
        eye: Height from which depth is measured, base z, [m]. Surfaces above this height are not drawn.

    Returns:
        Colour image (size, size, 3) uint8, and depth image (size, size) uint16 down from `eye` in the camera's own
        `depth_scale`; both are 0 where nothing was seen.

    Raises:
        UsageError: If size or extent are not positive, or the view needs too many points.
        FieldError: If the camera measures no depth.
    """
    if frame.depth is None:
        raise FieldError("a view from straight above needs depth; this camera measures none")
    return TopView.over(workspace, calibration, size, extent, eye).draw([(frame, calibration)])


def topdown(
    episode: Episode,
    steps: int | Sequence[int] | None = None,
    cameras: Sequence[str] | None = None,
    size: int = SIZE,
    extent: float | None = None,
    eye: float = EYE_M,
) -> TopDown:
    """Return views from straight above of a recorded episode, one for each chosen observation.

    A view is drawn from the latest frame of each camera at or before the observation. It is empty if there is none yet.

    Args:
        episode: Episode whose images are read.
        steps: Index of one observation, or indices of several, 0 to N. All observations by default.
        cameras: Names of the cameras whose images are combined. All cameras that have depth by default. The first
            camera gives the axes.
        size: Height and width of the views, [px].
        extent: Edge of the square that the views show, [m]. The wider side of the workspace by default.
        eye: Height from which depth is measured, base z, [m]. Surfaces above this height are not drawn.

    Returns:
        The views in the order of `steps`. If `steps` is a single index, the images have no leading axis.

    Raises:
        UsageError: If there is no such camera or step, size or extent are not positive, or a view needs too many
            points.
        FieldError: If a chosen camera has no depth, or no camera has depth.

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
    """Return the row of the latest frame of a camera at or before an observation, or None if there is none yet.

    Args:
        episode: Episode of the camera.
        camera: Camera whose frames are searched.
        step: Index of the observation, 0 to N.
    """
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
