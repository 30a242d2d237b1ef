"""Recording loop that records every episode, for any policy and any robot."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from collectors.recording.observed import constants, rows
from svfl_data.schema.robot import Observation, Policy, Robot

State = Mapping[str, np.ndarray]
"""True values that only a simulation knows, by name."""
OBJECT = "object"
"""Name of the state that is the pose of the task's object, (7,): position [m], quat_xyzw, base axes."""
Watcher = Callable[[Robot, Observation, NDArray[np.float32] | None], None]
"""Function that is called with every observation and the action that led to it, None at the first observation.

What the function does is not recorded."""


def unwatched(robot: Robot, observation: Observation, action: NDArray[np.float32] | None) -> None:
    """Do nothing with an observation, which is the default watcher."""


def record(
    robot: Robot,
    policy: Policy,
    max_steps: int,
    done: Callable[[], bool] = lambda: False,
    state: Callable[[], State] = dict,
    watch: Watcher = unwatched,
) -> dict[str, np.ndarray]:
    """Run a policy on a robot, which has been homed and tared, and record the episode.

    Args:
        robot: Robot to run the policy on.
        policy: Policy that returns an action for each observation, or None to end the episode.
        max_steps: Number of actions after which the episode ends, if neither the policy nor `done` has ended it.
        done: Function that returns whether the task is achieved, and is called after each action. Never by default.
        state: Function that returns the current true values. The value named `OBJECT` becomes ``streams/object/pose``,
            others become ``extra/state/``. No values by default.
        watch: Function that is called with every observation and action.

    Returns:
        The arrays of the episode without labels, by dataset path.

    Example:
        >>> from collectors.simulation.world import World
        >>> with contextlib.closing(World()) as robot:
        ...     robot.reset(np.random.SeedSequence(0))  # doctest: +SKIP
        ...     arrays = record(robot, lambda observation: np.array([1, 0, 0, -0.01, 0]), max_steps=5)  # doctest: +SKIP
    """
    observations = [robot.observe()]
    watch(robot, observations[-1], None)
    states = [state()]
    actions: list[NDArray[np.float32]] = []
    while len(actions) < max_steps and (chosen := policy(observations[-1])) is not None:
        actions.append(np.asarray(chosen, dtype=np.float32))  # the stored action equals the commanded action
        robot.step(actions[-1])
        observations.append(robot.observe())
        states.append(state())
        watch(robot, observations[-1], actions[-1])
        if done():
            break
    arrays: dict[str, np.ndarray] = constants(robot) | {
        "actions/action": np.array(actions, dtype=np.float32).reshape(-1, 5),
        "streams/wrench/t_ns": np.array(robot.wrench_t_ns),
        "streams/wrench/wrench": np.array(robot.wrench),
    }
    seen = [rows(observation) for observation in observations]
    for group, columns in seen[0].items():
        arrays |= {f"{group}/{name}": np.concatenate([one[group][name] for one in seen]) for name in columns}
    for name in states[0]:
        values = np.stack([one[name] for one in states])
        if name == OBJECT:
            arrays |= {"streams/object/t_ns": arrays["observations/t_ns"].copy(), "streams/object/pose": values}
        else:
            arrays[f"extra/state/{name}"] = values
    return arrays
