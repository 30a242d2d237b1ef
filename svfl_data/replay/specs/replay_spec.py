"""Specification of a replay buffer with the paper's inputs: one RGB-D camera, the wrist wrench and proprioception."""

from dataclasses import asdict, dataclass, fields
from typing import Any, Protocol

import numpy as np

from svfl_data.errors import DatasetError, FieldError
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.episode_builder import finite
from svfl_data.replay.specs.layout import REWARD, Array, Layout, Picture, Plane, Stream
from svfl_data.replay.specs.spec import Observation, Spec, difference
from svfl_data.replay.stored_episode import StoredEpisode, sparse_reward
from svfl_data.schema.action_bounds import ActionBounds, planar_limits
from svfl_data.schema.action_fields import ACTION, MAX_MOVE_M, MAX_TURN_RAD, planar_action
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.robot import Optics
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act

PARTS = {"wrench": WRENCH_PARTS, "proprio": PROPRIO_PARTS, "action": ACTION_PARTS}
MATRICES = ("image_axes", "intrinsics", "T_base_camera")
Rows = tuple[tuple[float, ...], ...]


class World(Protocol):
    """Part of a `collectors.simulation.world.World` that describes its camera, its workspace and its action bounds."""

    @property
    def camera(self) -> Optics:
        """First camera of the world."""

    @property
    def workspace(self) -> np.ndarray:
        """Lower and upper bounds of x, y, z of the workspace in base, shape (3, 2), [m]."""

    @property
    def action_bound(self) -> np.ndarray:
        """Largest absolute dx, dy, dz [m] and dtheta [rad] of an action, shape (4,)."""


class EnvironmentView(Protocol):
    """Part of a `collectors.environment.Environment` that describes its observations."""

    observation_space: Any
    view: Any
    eye: float

    @property
    def world(self) -> World:
        """Simulated world of the environment."""


@dataclass(frozen=True)
class ReplaySpec:
    """Properties that must be equal for transitions of different episodes to be mixed in one batch.

    Attributes:
        task: Name of the task.
        size: Height and width of the images as recorded, [px].
        depth_scale: Metres per unit of depth.
        image_axes: Matrix that turns base (x, y) into image-aligned (right, up), two rows.
        centre: Workspace centre, base (x, y), [m].
        intrinsics: Pinhole matrix of the camera, three rows, [px].
        T_base_camera: Pose of the camera in base, four rows, [m].
        view: View of the images: "camera" for the images of the camera itself, or a description of the view computed
            from them, such as "top, seen from 1 m".
        action_bounds: Largest displacement along an axis, [m], and largest turn, [rad], of one action.
    """

    task: str
    size: tuple[int, int]
    depth_scale: float
    image_axes: tuple[tuple[float, float], tuple[float, float]]
    centre: tuple[float, float]
    intrinsics: Rows
    T_base_camera: Rows
    view: str = "camera"
    action_bounds: tuple[float, float] = (MAX_MOVE_M, MAX_TURN_RAD)

    @classmethod
    def seen_by(
        cls,
        camera: Optics,
        size: tuple[int, int],
        workspace: np.ndarray,
        task: str,
        action_bounds: tuple[float, float] = (MAX_MOVE_M, MAX_TURN_RAD),
        view: str = "camera",
    ) -> "ReplaySpec":
        """Return the spec of an agent that sees the images of a camera.

        Args:
            camera: Camera whose images the agent sees: a `svfl_data.schema.episode.Camera` or a
                `svfl_data.schema.robot.Calibration`.
            size: Height and width of the images, [px].
            workspace: Lower and upper bounds of x, y, z of the workspace in base, shape (3, 2), [m].
            task: Name of the task.
            action_bounds: Largest displacement along an axis, [m], and largest turn, [rad], of one action.
            view: View of the images, as for the attribute `view`.
        """
        (a, b), (c, d) = np.asarray(camera.image_axes, np.float64).tolist()
        x, y = np.asarray(workspace, np.float64)[:2].mean(axis=1).tolist()
        lens, pose = _rows(camera.intrinsics), _rows(camera.T_base_camera)
        return cls(
            task, size, float(camera.depth_scale), ((a, b), (c, d)), (x, y), lens, pose, view, action_bounds
        )  # fmt: skip

    @classmethod
    def of_environment(cls, env: EnvironmentView, task: str) -> "ReplaySpec":
        """Return the spec of one of the environments of `collectors.environment`.

        Args:
            env: Environment without wrappers.
            task: Name of the environment's task.
        """
        height, width = env.observation_space["image"].shape[1:]
        world, most = env.world, env.world.action_bound.tolist()
        view = f"top, seen from {env.eye:g} m" if env.view == "top" else env.view
        return cls.seen_by(world.camera, (height, width), world.workspace, task, (most[0], most[-1]), view)

    @classmethod
    def of_episode(cls, episode: Episode, camera: Camera) -> "ReplaySpec":
        """Return the spec of a recorded episode.

        Args:
            episode: Recorded episode.
            camera: Camera of the episode whose images are used.
        """
        action = episode.declarations.at(ACTION)
        assert action is not None
        bounds = planar_limits(action)
        height, width = camera.arrays["color"].shape[1:3]
        return cls.seen_by(camera, (height, width), episode.workspace, episode.meta.task, bounds)

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> "ReplaySpec":
        """Restore a spec that was converted with `dataclasses.asdict` and stored as JSON.

        Args:
            found: Values of the attributes by name, as JSON gives them.

        Raises:
            ValueError: If the numbers are impossible for a spec, or have a wrong shape.
        """
        (a, b), (c, d) = found["image_axes"]
        (height, width), (x, y), bounds = found["size"], found["centre"], found["action_bounds"]
        scale = float(found["depth_scale"])
        axes, lens, pose = ((a, b), (c, d)), _rows(found["intrinsics"]), _rows(found["T_base_camera"])
        numbers = np.concatenate([np.ravel(part) for part in (axes, (x, y), lens, pose, (scale,), bounds)])
        if not np.isfinite(numbers).all() or scale <= 0 or min(height, width) < 1:
            raise ValueError("its spec has impossible numbers")
        move, turn = bounds
        return cls(
            str(found["task"]), (height, width), scale, axes, (x, y), lens, pose, str(found["view"]), (move, turn)
        )  # fmt: skip

    def require_equal(self, other: Spec, where: str, there: str) -> None:
        """Refuse another spec if it differs from this spec; see `svfl_data.replay.specs.spec.Spec`."""
        if not isinstance(other, ReplaySpec):
            raise difference("input", "the paper's (image, wrench, proprio)", "any input by its path", where, there)
        for field in fields(self):
            name, mine, its = field.name, getattr(self, field.name), getattr(other, field.name)
            if mine == its:
                continue
            if name in MATRICES:  # one row that differs is enough for the message
                row = next(row for row, (a, b) in enumerate(zip(mine, its, strict=True)) if a != b)
                name, mine, its = f"{name}[{row}]", mine[row], its[row]
            raise difference(name, mine, its, where, there)

    @property
    def bounds(self) -> ActionBounds:
        """Bounds of an action."""
        found = ActionBounds.of(planar_action(*self.action_bounds))
        assert found is not None
        return found

    def layout(self, config: ReplayConfig) -> Layout:
        """Return what is kept of an episode and given in a batch: all vectors in image-aligned axes.

        Args:
            config: Settings of the replay buffer, which give the number of frames and of readings.
        """
        color, depth = Array("color", (3, *self.size), "uint8"), Array("depth", self.size, "uint16")
        frames = Stream((color, depth), config.frames)
        wrench = Array("wrench", (6,), "float32", PARTS["wrench"])
        planes = Plane("color", (0, 3), divisor=255.0), Plane("depth", 3, smooth=False, factor=self.depth_scale)
        return Layout(
            (frames, Stream((wrench,), config.window, end="wrench_end")),
            (Array("proprio", (5,), "float32", PARTS["proprio"]),),
            Array("action", (5,), "float32", PARTS["action"]),
            (Picture("image", frames, planes, (4, -1, -1), "float32", self.size, flat=config.frames == 1),),
        )

    def kept(self, name: str, values: np.ndarray) -> np.ndarray:
        """Transform vectors from base axes to image-aligned axes, with positions from the workspace centre.

        Args:
            name: ``wrench``, ``proprio`` or ``action``.
            values: Vectors in base axes, shape (..., C).

        Returns:
            Vectors in image-aligned axes, shape (..., C), float32.
        """
        found = np.asarray(values, np.float64)
        if name == "proprio":
            found = found - np.array([0.0, *self.centre, 0.0, 0.0])
        return act(np.array(self.image_axes), found, PARTS[name]).astype(np.float32)

    def recorded(self, episode: Episode, camera: Camera) -> StoredEpisode:
        """Convert a recorded episode into a demonstration.

        Args:
            episode: Recorded episode that is fit for training (`svfl_data.checks.check_usable`).
            camera: Camera of the episode whose images are kept, one for each observation.

        Raises:
            DatasetError: If the camera has no frame at or before the first observation.
        """
        frames = np.searchsorted(camera.t_ns, episode.t_ns, side="right") - 1
        if (frames < 0).any():
            raise DatasetError(f"{episode.name}: camera {camera.name} had no frame yet at the first observation")
        arrays = {
            "color": np.ascontiguousarray(camera.color[frames].transpose(0, 3, 1, 2)),  # (N+1, H, W, 3) -> (N+1, 3, ..)
            "depth": camera.depth[frames],
            "wrench": self.kept("wrench", episode.tared_wrench),
            "wrench_end": np.searchsorted(episode.wrench_t_ns, episode.t_ns, side="right"),
            "proprio": self.kept("proprio", episode.proprio),
            "action": self.kept("action", episode.action),
            REWARD: sparse_reward(episode),
        }
        return StoredEpisode(arrays, terminated=episode.meta.success, expert=True)

    def observed(self, observation: Observation, layout: Layout) -> dict[str, np.ndarray]:
        """Return the rows of an observation of one of the environments of `collectors.environment`.

        Args:
            observation: ``image`` (4, H, W), ``wrench`` (T, 6) and ``proprio`` (5,), base axes.
            layout: Layout of the replay buffer.

        Raises:
            FieldError: If an array of the observation is missing or has a wrong shape or value.
        """
        for name in ("image", "wrench", "proprio"):
            if name not in observation:
                raise FieldError(f"observation: {name} is missing; it has {', '.join(observation) or 'nothing'}")
        image = finite("image", observation["image"], (4, *self.size))
        wrench = finite("wrench", observation["wrench"], (layout.streams[1].length, 6))
        proprio = finite("proprio", observation["proprio"], (5,))
        color, depth = self.pixels(image)
        return {"color": color[None], "depth": depth[None], "wrench": wrench, "proprio": proprio}

    def acted(self, action: np.ndarray) -> np.ndarray:
        """Return an action (5,) in image-aligned axes, float32.

        Raises:
            FieldError: If it has a wrong shape or value, or is beyond the bounds.
        """
        acted = finite("action", action, (5,))
        if fault := self.bounds.fault(acted[None]):
            raise FieldError(f"action: {fault[1]}")
        return self.kept("action", acted)

    def plain(self) -> dict[str, Any]:
        """Return the spec as plain values for files."""
        return asdict(self)

    def pixels(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Recover the exact integer colour and depth from which an image was computed.

        Args:
            image: RGB 0..1, then depth in [m], shape (4, H, W), as the environments of `collectors.environment` give
                it.

        Returns:
            Colour (3, H, W) uint8, and depth (H, W) uint16 in units of `depth_scale`.

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
