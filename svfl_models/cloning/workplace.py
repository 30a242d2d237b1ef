"""Where and how demonstrations were made: what a policy that learned from them must know to act."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from svfl_data.dataset import Dataset
from svfl_data.errors import DatasetError, TrainingError
from svfl_data.printable import printable
from svfl_data.reader import EpisodeReader
from svfl_models.cloning.hand_view import projection
from svfl_models.squashed_gaussian import CENTRE, SCALE

STEP_TOLERANCE = 0.1
"""Share by which the time of a step may differ between episodes."""
BEYOND = 1e-3
"""Share by which a recorded action may exceed the bounds: rounding."""
LARGEST_SIDE = 4096
"""Most pixels along a side of a camera's image, [px]."""
COMPONENTS = ("the gripper opening", "dx", "dy", "dz", "dtheta")


@dataclass(frozen=True)
class Workplace:
    """What all demonstrations have in common; plain values, kept in the checkpoint.

    Attributes:
        task: Name of the task.
        camera: Name of the camera.
        image_axes: Base (x, y) to image (right, up), 2 x 2.
        projection: Base point to pixel of the camera, 3 x 4 (`hand_view.projection`).
        centre: Of the workspace, base (x, y), [m].
        table: Height of the table, base z, [m]: the lower bound of the workspace.
        image_side: Height and width of the camera's images, [px].
        depth_scale: Metres per unit of depth, [m].
        step_ms: Time between two actions, [ms].
        switch: Whether the gripper was only ever commanded to open or to shut.
    """

    task: str
    camera: str
    image_axes: list[list[float]]
    projection: list[list[float]]
    centre: list[float]
    table: float
    image_side: int
    depth_scale: float
    step_ms: float
    switch: bool

    def __post_init__(self) -> None:
        shapes = {"image_axes": (2, 2), "projection": (3, 4), "centre": (2,)}
        for name in ("image_axes", "projection", "centre", "table", "image_side", "depth_scale", "step_ms"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape != shapes.get(name, ()) or not np.isfinite(values).all():
                raise TrainingError(f"{name} of a workplace cannot be {printable(getattr(self, name), 60)}")
        if self.image_side not in range(1, LARGEST_SIDE + 1) or not self.depth_scale > 0:
            raise TrainingError(f"a camera of {self.image_side} px and {self.depth_scale} m per unit of depth is none")

    def plain(self) -> dict[str, Any]:
        """As a dictionary of plain values, for files."""
        return asdict(self)


def workplace_of(dataset: Dataset, episodes: Sequence[int], camera: str | None = None) -> Workplace:
    """What demonstrations have in common, and that a policy can do what they do.

    Args:
        dataset: Where they lie.
        episodes: Which; at least one.
        camera: Whose images to use; the first one's (in alphabetical order) by default.

    Raises:
        DatasetError: If they differ in what a policy cannot tell apart: task, camera, workspace, time of a step; or if
            an action is not within a policy's bounds.
        FieldError: If an episode lacks a field.
    """
    first: tuple[int, Workplace] | None = None
    for index in episodes:
        reader = dataset.episode(index)
        if not reader.cameras:
            raise DatasetError(f"{reader.extent}: recorded without a camera, whose axes a policy's vectors have")
        found = _of_episode(reader, camera or reader.cameras[0])
        if first is None:
            first = index, found
            continue
        for name, here in found.plain().items():
            there = first[1].plain()[name]
            if name != "switch" and not _same(name, here, there):
                raise DatasetError(
                    f"{dataset.path}: episode {index} has {name} {here}, episode {first[0]} has {there}; "
                    "one policy learns from demonstrations of one task, camera, workspace and kind of action"
                )
        first = first[0], Workplace(**first[1].plain() | {"switch": first[1].switch and found.switch})
    if first is None:
        raise DatasetError(f"{dataset.path}: no episodes to learn from")
    return first[1]


def _of_episode(reader: EpisodeReader, camera: str) -> Workplace:
    height, width = reader[f"cameras/{camera}/depth"].shape[1:]
    if height != width:
        raise DatasetError(f"{reader.extent}: images of {camera} are {height} x {width} px; needed: square ones")
    action = reader["actions/action"][:]
    _check_bounds(action, str(reader.extent))
    return Workplace(
        task=reader.meta.task,
        camera=camera,
        image_axes=np.round(reader[f"cameras/{camera}/image_axes"][:], 9).tolist(),
        projection=np.round(_projection(reader, camera), 6).tolist(),
        centre=np.round(reader["workspace"][:2].mean(axis=1), 9).tolist(),
        table=round(float(reader["workspace"][:][2, 0]), 9),
        image_side=int(height),
        depth_scale=float(reader[f"cameras/{camera}/depth_scale"][()]),
        step_ms=float(np.median(np.diff(reader["observations/t_ns"][:])) / 1e6) if len(reader) else 0.0,
        switch=bool(np.isin(action[:, 0], (0, 1)).all()),
    )


def _projection(reader: EpisodeReader, camera: str) -> np.ndarray:
    return projection(*(reader[f"cameras/{camera}/{name}"][:] for name in ("intrinsics", "T_base_camera")))


def _check_bounds(action: np.ndarray, where: str) -> None:
    out = np.abs(action - np.array(CENTRE)) > np.array(SCALE) * (1 + BEYOND)
    if out.any():
        row, column = np.argwhere(out)[0]
        low, high = CENTRE[column] - SCALE[column], CENTRE[column] + SCALE[column]
        raise DatasetError(
            f"{where}: the action of step {row} has {action[row, column]:.4g} for {COMPONENTS[column]}; a policy's "
            f"bounds are {low:.4g} and {high:.4g}"
        )


def _same(name: str, here: Any, there: Any) -> bool:  # noqa: ANN401 - plain values
    return abs(here - there) <= STEP_TOLERANCE * there if name == "step_ms" else here == there
