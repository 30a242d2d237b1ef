"""Measures how often a trained policy succeeds in the gymnasium environment of its task, or in another one."""

import json
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console

from svfl_data.errors import TrainingError, UsageError
from svfl_data.reports.success_rate import wilson
from svfl_data.schema.input_spec import WINDOW
from svfl_data.schema.rates import RATE_FACTOR
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable
from svfl_data.system.progress.bars import Bars
from svfl_data.system.worker_processes import Died, run_jobs
from svfl_models.cloning import own_acting
from svfl_models.cloning.acting import ActingPolicy, acting
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.deployment_spec import OTHER_RATE, DeploymentSpec
from svfl_models.cloning.evaluation import other_environments
from svfl_models.cloning.recorded_inputs import of_plain
from svfl_models.networks.action_space import ActionSpace
from svfl_models.programs.policy_file import inputs_of
from svfl_models.training.provenance.session import Session, file, session

OUR_MODULE = "collectors.environment"
"""Module that declares the environments of this package's tasks."""
LONGEST = 10_000
"""Number of steps after which an episode of an environment without a limit of its own ends without success."""


@dataclass(frozen=True)
class Evaluation:
    """Result of the evaluation of a policy.

    Attributes:
        checkpoint: Path of the policy's checkpoint.
        environment: Gymnasium id of the environment.
        seed: Seed of the scenes.
        success: For each episode, whether it succeeded.
        steps: Number of steps of each episode.
        provenance: What the evaluation was made with; None if it is not known.
    """

    checkpoint: str
    environment: str
    seed: int
    success: list[bool]
    steps: list[int]
    provenance: Session | None = None

    @property
    def rate(self) -> float:
        """Share of the episodes that succeeded, 0..1."""
        return sum(self.success) / len(self.success)

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % interval of the success rate, 0..1."""
        return wilson(sum(self.success), len(self.success))

    @property
    def median_steps(self) -> float | None:
        """Median number of steps of the episodes that succeeded; None if none did."""
        lengths = [steps for steps, success in zip(self.steps, self.success, strict=True) if success]
        return float(np.median(lengths)) if lengths else None

    def __str__(self) -> str:
        low, high = self.interval
        length = "" if self.median_steps is None else f", {self.median_steps:g} steps (median)"
        return (
            f"{self.checkpoint}: {sum(self.success)} of {len(self.success)} episodes succeeded, {self.rate:.1%} "
            f"(95 % interval {low:.1%} to {high:.1%}){length}"
        )

    def plain(self) -> dict[str, Any]:
        """Return the attributes, the success rate, its interval and the median length as JSON values."""
        return asdict(self) | {"rate": self.rate, "interval": self.interval, "median_steps": self.median_steps}

    def save(self, file: Path) -> None:
        """Write the values of `plain` as JSON.

        Args:
            file: File to write.

        Raises:
            StorageError: If the file cannot be written.
        """
        write_atomically(file, (json.dumps(self.plain(), indent=2) + "\n").encode())


def environment_of(task: str) -> str:
    """Return the gymnasium id of a task's environment, prefixed with the module that declares the environment."""
    return f"{OUR_MODULE}:{other_environments.OURS}{task}-v0"


def evaluate(
    checkpoint: Path,
    episodes: int,
    seed: int = 0,
    workers: int = 1,
    console: Console | None = None,
    robot: str | None = None,
    environment: str | None = None,
) -> Evaluation:
    """Run a policy in several scenes, which are those of ``svfl-collect policy`` with the same seed.

    In an environment of another package, a scene is what the environment sets up with a seed of its own for each
    episode, and an episode succeeds if the last ``info["success"]`` is true, or, without such an entry, if the
    environment terminates.

    Args:
        checkpoint: Checkpoint file that ``svfl-train bc`` has written.
        episodes: Number of episodes to run, one per scene.
        seed: Seed of the scenes. No scene is that of a demonstration, whatever the seed of the demonstrations.
        workers: Number of worker processes; 1 runs the episodes in this process.
        console: Console that progress is printed on; standard error by default.
        robot: Name of the simulated robot that acts. By default the one of the demonstrations.
        environment: Gymnasium id of the environment, with the module that declares it if need be (``module:id``). By
            default that of the task of the demonstrations.

    Raises:
        SvflError: If the file is not a checkpoint of a policy, the task has no environment, the environment differs
            from that of the demonstrations (inputs, action, control rate, rate of the wrench or camera), or a worker
            process dies.
    """
    module = load_policy(checkpoint)
    other = environment is not None and not other_environments.is_ours(environment)
    if other and robot is not None:
        raise UsageError(f"environment {printable(environment, 80)} has its own robot; --robot is for those of svfl")
    environment = environment or environment_of(module.deployment.task)
    if not other and ":" not in environment:
        environment = f"{OUR_MODULE}:{environment}"
    provenance = session({"checkpoint": file(checkpoint)}, [seed])
    outcomes: dict[int, tuple[bool, int]] = {}
    with Bars(console) as bars:
        bar = bars.add("episode", episodes)
        for index, outcome in _outcomes(
            partial(Trial, checkpoint, environment, seed, robot, other), str(checkpoint), episodes, workers
        ):
            outcomes[index] = outcome
            succeeded = sum(success for success, _ in outcomes.values())
            bars.update(bar, advance=1, words=f"{succeeded} of {len(outcomes)} succeeded")
    success, steps = (list(values) for values in zip(*(outcomes[index] for index in range(episodes)), strict=True))
    return Evaluation(str(checkpoint), environment, seed, success, steps, provenance)


class Trial:
    """Policy and environment in which the policy is run, one episode per call.

    Args:
        checkpoint: Checkpoint file of the policy.
        environment: Gymnasium id of the environment.
        seed: Seed of the scenes.
        robot: Name of the simulated robot that acts; that of the demonstrations if None.
        other: Whether the environment is of another package, see `evaluation.other_environments`.
        render_mode: Gymnasium's render mode of the environment; None for no pictures.

    Raises:
        TrainingError: If the environment does not exist, or its steps, images, inputs or actions differ from those of
            the demonstrations.
    """

    def __init__(
        self,
        checkpoint: Path,
        environment: str,
        seed: int,
        robot: str | None = None,
        other: bool = False,
        render_mode: str | None = None,
    ) -> None:
        import gymnasium

        module = load_policy(checkpoint)
        self.deployment, self.seed, self.other, self.name = module.deployment, seed, other, str(checkpoint)
        robot = robot or self.deployment.robot
        options: dict[str, Any] = {"robot": robot} if robot else {}
        options |= {"render_mode": render_mode} if render_mode else {}
        if self.deployment.inputs:
            own = own_acting.opened(module, self.name)
            self._act: Callable[[dict[str, Any]], np.ndarray] = own
            options["inputs"] = inputs_of(own.facts.inputs)
        else:
            self._act = partial(_paper_action, acting(module), self.name)
            options["camera"] = self.deployment.camera or None
            window = module.policy.trunk.window
            options |= {"window": window} if window != WINDOW else {}  # which other environments need not know
        try:
            self.environment = gymnasium.make(environment, disable_env_checker=True, **({} if other else options))
        except (gymnasium.error.Error, UsageError, ValueError, ImportError) as error:  # ValueError: not a valid name
            reason = printable(" ".join(str(error).split()), 200)
            raise TrainingError(f"{checkpoint}: cannot be evaluated in {environment}: {reason}") from error
        if other:
            other_environments.expect_inputs(self.environment, module, self.name)
        _expect_same(self.environment, self.deployment, self.name)

    @torch.inference_mode()
    def __call__(self, index: int, watch: Callable[[], None] = lambda: None) -> tuple[bool, int]:
        """Run the episode with the number `index`, and return whether it succeeded and its number of steps.

        Args:
            index: Number of the episode.
            watch: Function that is called after the reset and after each step.
        """
        scene = (self.seed, index)
        begin = other_environments.begin(scene) if self.other else {"options": {"scene": scene}}
        observation, _ = self.environment.reset(**begin)
        ended, success, steps = False, False, 0
        watch()
        while not ended and steps < LONGEST:
            observation, _, terminated, truncated, info = self.environment.step(self._act(observation))
            success = bool(info.get("success", terminated))
            steps, ended = steps + 1, terminated or truncated
            watch()
        return success, steps


def _paper_action(policy: ActingPolicy, name: str, observation: dict[str, Any]) -> np.ndarray:
    """Return the action of a policy with the paper's inputs, (5,), within the bounds of its demonstrations."""
    side = policy.deployment.image_side
    unused = {
        "image": np.zeros((4, side, side)),
        "wrench": np.zeros((policy.policy.trunk.window, 6)),
        "proprio": np.zeros(5),
    }
    values = unused | observation
    image, wrench, proprio = (torch.from_numpy(np.asarray(values[one], np.float32)[None]) for one in unused)
    action = policy(image, wrench, proprio)[0].numpy()
    if not np.isfinite(action).all():
        raise TrainingError(f"{name}: the policy's action is not finite: {action.tolist()}")
    return np.clip(action, *policy.deployment.bounds).astype(np.float32)


def _expect_same(environment: Any, deployment: DeploymentSpec, name: str) -> None:  # noqa: ANN401 - gymnasium's, wrapped
    """Refuse an environment whose steps or images differ from those of the demonstrations.

    Raises:
        TrainingError: If they differ; the message says in what.
    """
    rate = environment.metadata.get("render_fps")  # other people's environments may not have it
    if rate and deployment.step_ms and not 1 / OTHER_RATE < deployment.step_ms * rate / 1000 < OTHER_RATE:
        raise TrainingError(
            f"{name}: learned from steps of {deployment.step_ms:.1f} ms, those of the environment last "
            f"{1000 / rate:.1f} ms"
        )
    if deployment.inputs:
        _expect_same_form(environment, deployment, name)
        return
    wrench_hz = getattr(environment.unwrapped, "wrench_hz", None)
    if wrench_hz and deployment.wrench_hz and not 1 / RATE_FACTOR <= wrench_hz / deployment.wrench_hz <= RATE_FACTOR:
        raise TrainingError(
            f"{name}: learned from wrench readings at {deployment.wrench_hz:.4g} Hz, those of the environment come at "
            f"{wrench_hz:.4g} Hz"
        )
    if not deployment.camera:
        return  # the policy has no image input
    side = environment.observation_space["image"].shape[-1]
    if side != deployment.image_side:
        raise TrainingError(f"{name}: learned from images of {deployment.image_side} px, the environment gives {side}")
    if not environment.has_wrapper_attr("image_axes"):
        return  # an environment of another package need not say
    axes = environment.get_wrapper_attr("image_axes")
    if not np.allclose(axes, deployment.image_axes):
        raise TrainingError(
            f"{name}: learned from camera {deployment.camera} with image axes {deployment.image_axes}, the "
            f"environment's are {np.round(axes, 3).tolist()}"
        )


def _expect_same_form(environment: Any, deployment: DeploymentSpec, name: str) -> None:  # noqa: ANN401 - as above
    """Refuse an environment whose actions, or whose cameras' axes, are not those that a policy of own inputs learned.

    Raises:
        TrainingError: If they differ.
    """
    assert deployment.action is not None
    space = ActionSpace.of_plain(deployment.action)
    if environment.action_space.shape != (len(space),):
        raise TrainingError(
            f"{name}: gives {len(space)} numbers ({printable(', '.join(space.names), 200)}), the environment's action "
            f"has shape {environment.action_space.shape}"
        )
    for one in of_plain(deployment.inputs):
        if one.kind == "image" and one.moves == "pixels" and environment.has_wrapper_attr("cameras"):
            axes = environment.get_wrapper_attr("cameras")[one.path.removeprefix("cameras/")].image_axes
            if not np.allclose(axes, deployment.image_axes):
                raise TrainingError(
                    f"{name}: learned from {one.path} with image axes {deployment.image_axes}, the environment's are "
                    f"{np.round(axes, 3).tolist()}"
                )


def _outcomes(
    prepare: Callable[[], Trial], name: str, episodes: int, workers: int
) -> Iterator[tuple[int, tuple[bool, int]]]:
    """Number and outcome of each episode, as they end.

    Raises:
        TrainingError: If a worker process dies.
    """
    if workers == 1:
        trial = prepare()
        try:
            yield from ((index, trial(index)) for index in range(episodes))
        finally:
            trial.environment.close()
        return
    for index, outcome in run_jobs(partial(_on_one_core, prepare), deque(range(episodes)), workers, finish=False):
        if isinstance(outcome, Died):
            raise TrainingError(f"{name}: a worker process died (killed, or out of memory)")
        yield index, outcome


def _on_one_core(prepare: Callable[[], Trial], place: int) -> Callable[[int], tuple[bool, int]]:
    """Return what tries the policy in this process, on one core."""
    torch.set_num_threads(1)
    return prepare()
