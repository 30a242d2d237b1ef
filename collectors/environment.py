"""The tasks as gymnasium environments.

    import gymnasium
    import collectors.environment

    env = gymnasium.make("svfl/block_picking-v0")
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

``gymnasium.make("collectors.environment:svfl/block_picking-v0")`` does the import by itself.
"""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from collectors.observations import InputObservations, PaperObservations, View
from collectors.robots import make as make_robot
from collectors.simulation.camera import CAMERAS, cameras_named
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.tasks import TASKS, task_class
from collectors.tasks.gripper import Gripper, Moves
from collectors.tasks.task import MAX_STEPS, POLICY_ATTEMPT, Task, attempt_seed
from svfl_data.errors import UsageError
from svfl_data.schema.input_spec import WINDOW, InputSpec
from svfl_data.schema.robot import Calibration, Observation
from svfl_data.signals.top_view import EYE_M
from svfl_data.system.own_process import OwnProcess


class Environment(OwnProcess, gymnasium.Env[Any, NDArray[np.float32]]):
    """One task as a gymnasium environment with a sparse reward: 1 at success, which ends the episode, and 0 before.

    An observation is a dictionary of float32 arrays:

    - ``image`` (4, H, W): RGB in 0..1, then depth in [m], which is 0 where nothing was seen. The image is that of
      `camera` or, if `view` is "top", the same image reprojected to the view from straight above, with the depth
      measured down from `eye`.
    - ``wrench`` (64, 6): the last 64 (`window`) readings at 500 Hz, the latest one last, tared, [N] and [N m], base
      axes, about the sensor origin.
    - ``proprio`` (5,): gripper opening 0..1, TCP x, y, z [m], yaw [rad], in base.

    With `inputs`, an observation is instead a dictionary of what `svfl_data.sampling.samples.Samples` gives for the
    same inputs at a step, by the same keys, such as ``cameras/wrist/color`` (1, H, W, 3) uint8,
    ``cameras/wrist/image_axes`` (1, 2, 2) and ``streams/wrench/wrench`` (T, 6), but no ``.../padding``, ``.../age``.

    An action is float32 (5,): gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes, within the paper's bounds
    (0.025 m, pi/16). One step takes 50 ms. An action outside the bounds is clipped to them. An action that is not five
    finite numbers raises `UsageError`.

    ``info["success"]`` says whether the task is achieved now. Vectors are in base axes: `image_axes` turns them into
    the axes of the image (docs/simulation.md).

    The environment works only in the process that made it, and can be neither pickled nor copied. Give a vectorised
    environment a function that makes an `Environment`, as `gymnasium.make_vec` does.

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
        camera: str | None = None,
        robot: str | None = None,
        inputs: InputSpec | None = None,
        window: int = WINDOW,
    ) -> None:
        """Open the simulated world of a task.

        Args:
            task: Name of the task, one of `collectors.TASKS`.
            world: Configuration of the world: physics, arm, sensors and cameras. None means ``WorldConfig()``, with
                `camera` in place of its camera if that is named.
            view: Content of ``image``: "camera" is the image of `camera`, and "top" is that image reprojected to the
                view from straight above.
            eye: Height from which the view "top" looks down, base z, [m]. Whatever is higher is not drawn. 0.1 looks
                under the palm of a gripper that is low over an object.
            render_mode: With "rgb_array", `render` returns the colour image of `camera`. With None it returns None.
            camera: Name of the camera whose image is observed. May be None if the world has one camera.
            robot: Name of the simulated robot (`collectors.robots`), in place of that of `world`. None means the robot
                of `world`, which is the Panda by default.
            inputs: What is observed, by dataset path, in place of the paper's three arrays: cameras, windows of streams
                and vectors. Without `world`, the world has the cameras of these inputs.
            window: Number of readings of ``wrench``.

        Raises:
            UsageError: If no task, view, camera or robot has that name, or the world has several cameras and none is
                named.
            FieldError: If a simulated robot does not observe one of the inputs.
        """
        if view not in ("camera", "top"):
            raise UsageError(f"no view {view!r}; there are camera, top")
        self._task_class = task_class(task)
        needed = inputs.cameras if inputs else (camera,) if camera in CAMERAS else ()
        if world is None and needed:
            world = WorldConfig(cameras=cameras_named(needed))
        if robot:
            world = replace(world or WorldConfig(), robot=make_robot(robot))
        self.camera = _chosen(camera, world or WorldConfig(), inputs)
        self.world = World(world)
        self.view, self.eye, self.render_mode = view, eye, render_mode
        self.task: Task | None = None
        self._steps = 0
        self._seen: Observation | None = None
        self._observations = (
            PaperObservations(self.world, self.camera, view, eye, window)
            if inputs is None
            else InputObservations(self.world, inputs)
        )
        self.observation_space = self._observations.space
        bound = self.world.action_bound.astype(np.float32)
        self.action_space = spaces.Box(
            np.concatenate([[0], -bound]).astype(np.float32), np.concatenate([[1], bound]).astype(np.float32)
        )

    @property
    def image_axes(self) -> NDArray[np.float64]:
        """Matrix, (2, 2), that turns a vector (x, y) in base axes into (right, up) in the axes of the image."""
        return self.world.cameras[self.camera].image_axes

    @property
    def wrench_hz(self) -> float:
        """Rate of the wrench readings, [Hz]."""
        return 1e9 / self.world.config.physics_dt_ns

    @property
    def cameras(self) -> dict[str, Calibration]:
        """Calibration of each camera of the world by name."""
        return self.world.cameras

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        """Draw a scene and set it up. The same seed gives the same scene and the same sensor noise.

        Args:
            seed: Seed of this episode, and of the later episodes that are begun with None. None continues the random
                numbers of the last seed.
            options: ``{"scene": (seed, index)}`` sets up, instead of the scene that `seed` gives, the scene with this
                index among those in which policies are evaluated with this seed; no demonstration shows one of them.
                ``{"seed_sequence": numpy.random.SeedSequence}`` sets up the scene of that seed sequence, such as the
                scene of a demonstration. None means neither.

        Returns:
            The first observation, and ``info`` with the entry ``success``.
        """
        self.check_process()
        super().reset(seed=seed)
        drawn = np.random.SeedSequence(int(self.np_random.integers(2**63)))
        chosen = options or {}
        if "scene" in chosen:
            policy_seed, index = chosen["scene"]
            drawn = attempt_seed(policy_seed, index, POLICY_ATTEMPT)
        self._observations.forget()
        self.task = self._task_class.begin(self.world, chosen.get("seed_sequence", drawn))
        self._steps = 0
        return self._observe(), {"success": self.task.success()}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, NDArray[np.float32]], float, bool, bool, dict[str, Any]]:
        """Carry out an action.

        Args:
            action: Gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes, (5,).

        Returns:
            The observation after the action, the reward (1.0 at success, otherwise 0.0), whether the episode ended by
            success, whether it ended by the limit of `MAX_STEPS` steps, and ``info`` with the entry ``success``.

        Raises:
            UsageError: If `step` is called before the first `reset`, or the action is not five finite numbers.
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
        """Return the actions of the scripted expert for this episode, as an iterator.

        Take the next action from the iterator only after `step` has carried out the action before it.

        Args:
            noise: Amount by which demonstrations differ: 0 not at all, 1 as intended, 2 at most.
            seed: Seed of the differences between demonstrations.

        Raises:
            UsageError: If `expert` is called before the first `reset`.
        """
        self.check_process()
        if self.task is None:
            raise UsageError("expert before reset: call reset() to begin an episode")
        return self.task.expert(Gripper(self.world, np.random.default_rng(seed), noise))

    def render(self) -> NDArray[np.uint8] | None:
        """Return the latest colour image of `camera`, (H, W, 3) uint8 RGB.

        Without a `render_mode`, and before the first `reset`, it returns None.
        """
        self.check_process()
        if self.render_mode is None or self._seen is None:
            return None
        return self._seen.frames[self.camera].color

    def close(self) -> None:
        """Release the world. Closing it twice does no harm."""
        self.world.close()

    def _observe(self) -> dict[str, NDArray[Any]]:
        self._seen = self.world.observe()
        return self._observations(self._seen)


def _chosen(camera: str | None, world: WorldConfig, inputs: InputSpec | None) -> str:
    """Return the name of the camera whose image is observed, and which `Environment.render` shows.

    Raises:
        UsageError: If there is no such camera, or there are several and none is named.
    """
    have = ", ".join(world.cameras) or "none"
    if camera is None and inputs is not None:
        return inputs.cameras[0] if inputs.cameras else next(iter(world.cameras))
    if camera is None and len(world.cameras) == 1:
        return next(iter(world.cameras))
    if camera is None:
        raise UsageError(f"name the camera that the environment observes (camera=); the world's cameras: {have}")
    if camera not in world.cameras:
        raise UsageError(f"no camera {camera!r}; the world's cameras: {have}")
    return camera


def make(task: str, world: WorldConfig | None = None, **options: Any) -> Environment:  # noqa: ANN401 - see `Environment`
    """Make a task's gymnasium environment.

    Args:
        task: Name of the task, one of `collectors.TASKS`.
        world: Configuration of the world: physics, arm, sensors and cameras. None means ``WorldConfig()``, whose
            numbers are the paper's where the paper gives them.
        options: Further arguments of `Environment`: `view`, `eye`, `render_mode`, `camera`, `robot`, `inputs` and
            `window`.

    Raises:
        UsageError: If no task, view, camera or robot has that name, or no camera is named where there are several.

    Example:
        >>> with contextlib.closing(make("block_picking")) as env:
        ...     observation, info = env.reset(seed=0)
        ...     observation["wrench"].shape, info["success"]
        ((64, 6), False)
    """
    return Environment(task, world, **options)


def normalised(env: gymnasium.Env) -> gymnasium.Env:
    """Return the environment with actions in -1..1, where -1 and 1 are the bounds of each component."""
    return gymnasium.wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0))


def register() -> None:
    """Register every task with gymnasium as ``svfl/<task>-v0``."""
    for task in TASKS:
        gymnasium.register(f"svfl/{task}-v0", "collectors.environment:Environment", kwargs={"task": task})


register()
