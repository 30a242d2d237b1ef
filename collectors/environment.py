"""The tasks as gymnasium environments.

    import gymnasium
    import collectors.environment

    env = gymnasium.make("svfl/block_picking-v0")
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

``gymnasium.make("collectors.environment:svfl/block_picking-v0")`` does the import by itself.
"""

from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.tasks import TASKS, task_class
from collectors.tasks.gripper import Gripper, Moves
from collectors.tasks.task import MAX_STEPS, POLICY_ATTEMPT, Task, attempt_seed
from svfl_data.errors import UsageError
from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.robot import Observation
from svfl_data.signals.top_view import EYE_M
from svfl_data.signals.topdown import topdown_frame
from svfl_data.system.own_process import OwnProcess

View = Literal["camera", "top"]


class Environment(OwnProcess, gymnasium.Env[Any, NDArray[np.float32]]):
    """One task with a sparse reward: 1 at success, which ends the episode, 0 before.

    Observation, all float32:

    - ``image`` (4, H, W): RGB 0..1, then depth in [m], 0 where nothing was seen. Of the first camera, or seen from
      straight above if `view` is "top".
    - ``wrench`` (64, 6): the last readings at 500 Hz, latest last, tared, [N] and [N m], base axes, about the sensor
      origin.
    - ``proprio`` (5,): gripper opening 0..1, TCP x, y, z [m], yaw [rad], base.

    Action, float32 (5,): gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes, within the paper's bounds
    (0.025 m, pi/16); one step is 50 ms. An action outside the bounds is clipped to them; one that is not five finite
    numbers raises `UsageError`.

    ``info["success"]`` says whether the task is achieved now. Vectors are in base axes: `image_axes` takes them to
    those of the image (docs/simulation.md).

    It works in the process that made it only, and can be neither pickled nor copied: give vectorised environments a
    function that makes one, as `gymnasium.make_vec` does.

    Example:
        >>> with contextlib.closing(Environment("block_picking")) as env:
        ...     observation, info = env.reset(seed=0)
        ...     _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        >>> sorted(observation)
        ['image', 'proprio', 'wrench']
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - as gymnasium wants it

    def __init__(
        self,
        task: str,
        world: WorldConfig | None = None,
        view: View = "camera",
        eye: float = EYE_M,
        render_mode: str | None = None,
    ) -> None:
        """Open a world.

        Args:
            task: Name of the task.
            world: All numbers of the world.
            view: What ``image`` shows: the first camera's picture, or that reprojected to the view from above.
            eye: Height from which "top" looks down, base z, [m]; what is higher is not drawn. 0.1 looks under the palm
                of a gripper that is low over an object.
            render_mode: None or "rgb_array": what `render` gives.

        Raises:
            UsageError: If there is no such task or view.
        """
        if view not in ("camera", "top"):
            raise UsageError(f"no view {view!r}; there are camera, top")
        self._task_class = task_class(task)
        self.world = World(world)
        self.view, self.eye, self.render_mode = view, eye, render_mode
        self.task: Task | None = None
        self._steps = 0
        self._seen: Observation | None = None
        camera = next(iter(self.world.config.cameras.values()))
        high = np.ones((4, camera.height, camera.width), np.float32)
        high[3] = 2**16 * camera.depth_scale
        reach = np.array([1.1, 2.0, 2.0, 2.0, np.pi], np.float32)  # farther than the arm can be
        self.observation_space = spaces.Dict(
            {
                "image": spaces.Box(np.zeros_like(high), high, dtype=np.float32),
                "wrench": spaces.Box(-np.inf, np.inf, (WINDOW, 6), np.float32),
                "proprio": spaces.Box(-reach, reach, dtype=np.float32),
            }
        )
        bound = self.world.action_bound.astype(np.float32)
        self.action_space = spaces.Box(
            np.concatenate([[0], -bound]).astype(np.float32), np.concatenate([[1], bound]).astype(np.float32)
        )

    @property
    def image_axes(self) -> NDArray[np.float64]:
        """Base (x, y) to image (right, up), (2, 2)."""
        return self.world.camera.image_axes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Draw a scene and set it up. The same seed gives the same scene and the same noise.

        Args:
            seed: Seed of this episode, and of those after it that are begun without one.
            options: ``{"scene": (seed, index)}`` gives instead the scene with this index among those of this seed in
                which policies are tried; no demonstration shows one of them. ``{"seed_sequence":
                numpy.random.SeedSequence}`` gives the scene that is drawn from it, such as a demonstration's.
        """
        self.check_process()
        super().reset(seed=seed)
        drawn = np.random.SeedSequence(int(self.np_random.integers(2**63)))
        chosen = options or {}
        if "scene" in chosen:
            policy_seed, index = chosen["scene"]
            drawn = attempt_seed(policy_seed, index, POLICY_ATTEMPT)
        self.task = self._task_class.begin(self.world, chosen.get("seed_sequence", drawn))
        self._steps = 0
        return self._observe(), {"success": self.task.success()}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, NDArray[np.float32]], float, bool, bool, dict[str, Any]]:
        """Carry out an action.

        Raises:
            UsageError: Before the first `reset`, or if the action is not five finite numbers.
        """
        self.check_process()
        if self.task is None:
            raise UsageError("step before reset: call reset() to begin an episode")
        self.world.step(action)
        self._steps += 1
        success = self.task.success()
        truncated = self._steps >= MAX_STEPS and not success
        return self._observe(), float(success), success, truncated, {"success": success}

    def expert(self, noise: float = 1.0, seed: int = 0) -> Moves:
        """The scripted expert's actions for this episode; ask for the next one after each step.

        Args:
            noise: How much demonstrations differ.
            seed: Seed of the difference.

        Raises:
            UsageError: Before the first `reset`.
        """
        self.check_process()
        if self.task is None:
            raise UsageError("expert before reset: call reset() to begin an episode")
        return self.task.expert(Gripper(self.world, np.random.default_rng(seed), noise))

    def render(self) -> NDArray[np.uint8] | None:
        """The first camera's colour picture, (H, W, 3) uint8, if `render_mode` is "rgb_array"."""
        self.check_process()
        if self.render_mode is None or self._seen is None:
            return None
        return next(iter(self._seen.frames.values())).color

    def close(self) -> None:
        """Release the world; closing twice is harmless."""
        self.world.close()

    def _observe(self) -> dict[str, NDArray[np.float32]]:
        seen = self._seen = self.world.observe()
        return {"image": self._image(seen), "wrench": seen.wrench, "proprio": seen.proprio}

    def _image(self, seen: Observation) -> NDArray[np.float32]:
        frame, calibration = next(iter(seen.frames.values())), self.world.camera
        color, depth = frame.color, frame.depth
        if self.view == "top":
            color, depth = topdown_frame(frame, calibration, self.world.workspace, size=len(color), eye=self.eye)
        image = np.empty((4, *depth.shape), np.float32)
        image[:3] = color.transpose(2, 0, 1) / np.float32(255)
        image[3] = depth * np.float32(calibration.depth_scale)
        return image


def make(task: str, world: WorldConfig | None = None, **options: Any) -> Environment:  # noqa: ANN401 - see `Environment`
    """A task as a gymnasium environment.

    Args:
        task: Its name, one of `collectors.TASKS`.
        world: All numbers of the world: physics, arm, sensors and cameras; the paper's by default.
        options: Further arguments of `Environment`.

    Raises:
        UsageError: If there is no such task or view.

    Example:
        >>> with contextlib.closing(make("block_picking")) as env:
        ...     observation, info = env.reset(seed=0)
        ...     observation["wrench"].shape, info["success"]
        ((64, 6), False)
    """
    return Environment(task, world, **options)


def normalised(env: gymnasium.Env) -> gymnasium.Env:
    """The same environment with actions in -1..1: -1 and 1 are the bounds of each component."""
    return gymnasium.wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0))


def register() -> None:
    """Make every task known to gymnasium as ``svfl/<task>-v0``."""
    for task in TASKS:
        gymnasium.register(f"svfl/{task}-v0", "collectors.environment:Environment", kwargs={"task": task})


register()
