"""Recording loop that records every episode, for any policy and any robot, into memory or into a file."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from collectors.recording.observed import rows
from collectors.recording.sinks import Memory, Sink
from svfl_data.errors import CollectError
from svfl_data.schema.robot import Observation, Policy, Readings, Watcher
from svfl_data.schema.robot import Robot as Robot  # one of the public names of this package

State = Mapping[str, np.ndarray]
"""True values that are known only in a simulation, by name."""
OBJECT = "object"
"""Name of the state that is the pose of the task's object, (7,): position [m], quat_xyzw, base axes."""


def unwatched(robot: Robot, observation: Observation, action: NDArray[np.float32] | None, readings: Readings) -> None:
    """Do nothing with an observation, which is the default watcher."""


def record(
    robot: Robot,
    policy: Policy,
    max_steps: int,
    done: Callable[[], bool] = lambda: False,
    state: Callable[[], State] = dict,
    watch: Watcher = unwatched,
) -> dict[str, np.ndarray]:
    """Run a policy on a robot, which has been homed and tared, and record the episode in memory.

    Args:
        robot: Robot to run the policy on.
        policy: Policy that returns an action for each observation, or None to end the episode. It first forgets the
            past (`forget_past`).
        max_steps: Number of actions after which the episode ends, if neither the policy nor `done` has ended it.
        done: Function that returns whether the task is achieved, and is called after each action. Never by default.
        state: Function that returns the current true values. The value named `OBJECT` becomes ``streams/object/pose``,
            others become ``extra/state/``. No values by default.
        watch: Function that is called with every observation and action.

    Returns:
        The arrays of the episode without labels, by dataset path.

    Raises:
        CollectError: If the policy's action has another shape than the robot's.

    Example:
        >>> from collectors.simulation.world import World
        >>> with contextlib.closing(World()) as robot:
        ...     robot.reset(np.random.SeedSequence(0))  # doctest: +SKIP
        ...     arrays = record(robot, lambda observation: np.array([1, 0, 0, -0.01, 0]), max_steps=5)  # doctest: +SKIP
    """
    memory = Memory()
    record_into(memory, robot, policy, max_steps, done, state, watch)
    none = np.zeros((0, int(robot.action.shape[1])), robot.action.dtype)
    return {"actions/action": none} | dict(robot.constants()) | memory.arrays()


def record_into(
    sink: Sink,
    robot: Robot,
    policy: Policy,
    max_steps: int,
    done: Callable[[], bool] = lambda: False,
    state: Callable[[], State] = dict,
    watch: Watcher = unwatched,
) -> int:
    """Run a policy on a robot, which has been homed and tared, and pass the rows of the episode on as they come.

    The constants of the robot (`Robot.constants`) are not among them. The robot is stopped at the end, also when an
    error ends the episode.

    Args:
        sink: Object that takes the rows.
        robot: Robot to run the policy on.
        policy: Policy that returns an action for each observation, as for `record`.
        max_steps: Number of actions after which the episode ends.
        done: Function that returns whether the task is achieved, as for `record`.
        state: Function that returns the current true values, as for `record`.
        watch: Function that is called with every observation and action.

    Returns:
        The number of actions.

    Raises:
        CollectError: If the policy's action has another shape than the robot's.
    """
    cameras, latest_ns, streamed = robot.cameras, dict[str, int](), set[str]()

    def observe(action: NDArray[np.float32] | None) -> Observation:
        seen, readings = robot.observe(), robot.readings()
        streamed.update(readings)
        for group, columns in rows(seen, cameras).items():
            t_ns = int(columns["t_ns"][0])
            if group not in streamed and t_ns != latest_ns.get(group):  # a slow camera's frame is seen twice
                latest_ns[group] = t_ns
                sink.append(group, **columns)
        for group, new in readings.items():
            if len(new["t_ns"]):
                sink.append(group, **new)
        _append_state(sink, seen.t_ns, state())
        watch(robot, seen, action, readings)
        return seen

    try:
        forget_past(policy)
        seen = observe(None)
        for step in range(max_steps):
            if (chosen := policy(seen)) is None:
                return step
            action = _checked(chosen, robot)  # the stored action equals the commanded action
            sink.append("actions", action=action[None])
            robot.step(action)
            seen = observe(action)
            if done():
                return step + 1
        return max_steps
    finally:
        robot.stop()


def forget_past(policy: Policy) -> None:
    """Tell a policy that another episode begins, if it keeps a past (`svfl_data.schema.robot.Policy`).

    Args:
        policy: Any policy.
    """
    forget = getattr(policy, "forget", None)
    if callable(forget):
        forget()


def _checked(action: NDArray[np.float32], robot: Robot) -> NDArray[np.float32]:
    """Return an action with the dtype of the robot's actions."""
    made: NDArray[np.float32] = np.asarray(action, dtype=robot.action.dtype)
    if made.shape != robot.action.shape[1:]:
        names = ", ".join(robot.action.components) or "without names"
        raise CollectError(
            f"the policy gives an action of shape {made.shape}; robot {robot.name} takes {robot.action.shape[1]} "
            f"numbers ({names})"
        )
    return made


def _append_state(sink: Sink, t_ns: int, values: State) -> None:
    """Append the true values that belong to an observation."""
    if OBJECT in values:
        sink.append("streams/object", t_ns=np.array([t_ns], np.int64), pose=values[OBJECT][None])
    others = {name: value[None] for name, value in values.items() if name != OBJECT}
    if others:
        sink.append("extra/state", **others)
