"""What all episodes of a replay buffer have in common, and the axes in which it keeps their vectors."""

from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from svfl_data.errors import DatasetError, FieldError
from svfl_data.schema.action_bounds import ActionBounds
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.robot import Optics
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act

MATRICES = ("image_axes", "intrinsics", "T_base_camera")
Rows = tuple[tuple[float, ...], ...]


class World(Protocol):
    """What a `collectors.simulation.world.World` tells about its camera and its robot."""

    @property
    def camera(self) -> Optics:
        """The first camera."""

    @property
    def workspace(self) -> np.ndarray:
        """Bounds of x, y, z in base, shape (3, 2), [m]."""

    @property
    def action_bound(self) -> np.ndarray:
        """Largest dx, dy, dz [m] and dtheta [rad] of an action, (4,)."""


class EnvironmentView(Protocol):
    """What a `collectors.environment.Environment` tells about its pictures."""

    observation_space: Any
    view: Any
    eye: float

    @property
    def world(self) -> World:
        """Where it all happens."""


@dataclass(frozen=True)
class ReplaySpec:
    """Transitions may be mixed in one batch if all of this is equal.

    Attributes:
        task: Name of the task.
        size: Height and width of the images as recorded, [px].
        depth_scale: Metres per unit of depth.
        image_axes: Base (x, y) to image-aligned (right, up), two rows.
        centre: Workspace centre, base (x, y), [m].
        intrinsics: Pinhole matrix of the camera, three rows, [px].
        T_base_camera: Pose of the camera in base, four rows, [m].
        view: What the images show: "camera" is what the camera sees, anything else what has been made of it.
        action_bounds: Largest displacement along an axis, [m], and turn, [rad], of one action; None if unknown.
    """

    task: str
    size: tuple[int, int]
    depth_scale: float
    image_axes: tuple[tuple[float, float], tuple[float, float]]
    centre: tuple[float, float]
    intrinsics: Rows
    T_base_camera: Rows
    view: str = "camera"
    action_bounds: tuple[float, float] | None = None

    @classmethod
    def seen_by(
        cls,
        camera: Optics,
        size: tuple[int, int],
        workspace: np.ndarray,
        task: str,
        action_bounds: tuple[float, float] | None = None,
        view: str = "camera",
    ) -> "ReplaySpec":
        """The spec of what an agent sees.

        Args:
            camera: Whose images it sees: an `episode.Camera` or a `svfl_data.schema.robot.Calibration`.
            size: Height and width of its images, [px].
            workspace: Bounds of x, y, z in base, shape (3, 2), [m].
            task: Name of the task.
            action_bounds: Largest displacement, [m], and turn, [rad], of one action.
            view: What the images show.
        """
        (a, b), (c, d) = np.asarray(camera.image_axes, np.float64).tolist()
        x, y = np.asarray(workspace, np.float64)[:2].mean(axis=1).tolist()
        lens, pose = _rows(camera.intrinsics), _rows(camera.T_base_camera)
        return cls(
            task, size, float(camera.depth_scale), ((a, b), (c, d)), (x, y), lens, pose, view, action_bounds
        )  # fmt: skip

    @classmethod
    def of_environment(cls, env: EnvironmentView, task: str) -> "ReplaySpec":
        """The spec of what one of the environments of `collectors.environment` shows.

        Args:
            env: The environment, unwrapped.
            task: Name of its task.
        """
        height, width = env.observation_space["image"].shape[1:]
        world, most = env.world, env.world.action_bound.tolist()
        view = f"top, seen from {env.eye:g} m" if env.view == "top" else env.view
        return cls.seen_by(world.camera, (height, width), world.workspace, task, (most[0], most[-1]), view)

    @classmethod
    def of_episode(cls, episode: Episode, camera: Camera) -> "ReplaySpec":
        """The spec of a recorded episode seen by one of its cameras."""
        found = ActionBounds.of(episode.meta.config)
        bounds = (found.move, found.turn) if found.declared else None
        height, width = camera.arrays["color"].shape[1:3]
        return cls.seen_by(camera, (height, width), episode.workspace, episode.meta.task, bounds)

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> "ReplaySpec":
        """What `dataclasses.asdict` and JSON have made of a spec."""
        (a, b), (c, d) = found["image_axes"]
        (height, width), (x, y), bounds = found["size"], found["centre"], found["action_bounds"]
        scale = float(found["depth_scale"])
        axes, lens, pose = ((a, b), (c, d)), _rows(found["intrinsics"]), _rows(found["T_base_camera"])
        numbers = np.concatenate([np.ravel(part) for part in (axes, (x, y), lens, pose, (scale,), bounds or ())])
        if not np.isfinite(numbers).all() or scale <= 0 or min(height, width) < 1:
            raise ValueError("its spec has impossible numbers")
        bounds = tuple(bounds) if bounds else None
        return cls(
            str(found["task"]), (height, width), scale, axes, (x, y), lens, pose, str(found["view"]), bounds
        )  # fmt: skip

    def require_equal(self, other: "ReplaySpec", where: str, there: str) -> None:
        """Refuse what cannot be mixed with this.

        Args:
            other: The other spec.
            where: Where this one is from, for the message.
            there: Where the other one is from.

        Raises:
            DatasetError: If they differ.
        """
        for field in fields(self):
            name, mine, its = field.name, getattr(self, field.name), getattr(other, field.name)
            if mine == its:
                continue
            if name in MATRICES:  # one row tells enough
                row = next(row for row, (a, b) in enumerate(zip(mine, its, strict=True)) if a != b)
                name, mine, its = f"{name}[{row}]", mine[row], its[row]
            raise DatasetError(f"{there}: its {name} is {its}, but {mine} in {where}; one replay buffer holds one kind")

    @property
    def bounds(self) -> ActionBounds:
        """Of an action; the paper's if nothing else is known."""
        return ActionBounds(*self.action_bounds, origin="the replay buffer") if self.action_bounds else ActionBounds()

    def proprio(self, values: np.ndarray) -> np.ndarray:
        """Base axes and origin to image-aligned axes about the workspace centre, shape (..., 5), float32."""
        centred = np.asarray(values, np.float64) - np.array([0.0, *self.centre, 0.0, 0.0])
        return act(np.array(self.image_axes), centred, PROPRIO_PARTS).astype(np.float32)

    def wrench(self, values: np.ndarray) -> np.ndarray:
        """Base axes to image-aligned axes, shape (..., 6), float32."""
        return act(np.array(self.image_axes), np.asarray(values, np.float64), WRENCH_PARTS).astype(np.float32)

    def action(self, values: np.ndarray) -> np.ndarray:
        """Base axes to image-aligned axes, shape (..., 5), float32."""
        return act(np.array(self.image_axes), np.asarray(values, np.float64), ACTION_PARTS).astype(np.float32)

    def pixels(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What an image was made from, exactly.

        Args:
            image: RGB 0..1, then depth in [m], shape (4, H, W), as the environments give it.

        Returns:
            Colour (3, H, W) uint8 and depth (H, W) uint16.

        Raises:
            FieldError: If a number is out of range.
        """
        color, depth = np.rint(image[:3] * 255.0), np.rint(image[3] / self.depth_scale)
        for name, units, most in (("colour", color, 255), ("depth", depth, 2**16 - 1)):
            low, high = float(units.min()), float(units.max())
            if low < 0 or high > most:
                unit = "255" if name == "colour" else f"1 / {self.depth_scale:g} m"
                raise FieldError(f"image: {name} from {low:g} to {high:g} in units of {unit}; 0 to {most} are possible")
        return color.astype(np.uint8), depth.astype(np.uint16)


def _rows(matrix: np.ndarray | list[list[float]]) -> Rows:
    return tuple(tuple(row) for row in np.asarray(matrix, np.float64).tolist())
