"""Conditions under which demonstrations were recorded, which a policy trained on them needs in order to act."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from operator import itemgetter
from typing import Any

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, TrainingError, UsageError
from svfl_data.sampling.named_camera import named_camera
from svfl_data.schema.action_bounds import planar_limits
from svfl_data.schema.action_fields import ACTION, MAX_MOVE_M, MAX_TURN_RAD, planar_action
from svfl_data.schema.clocks import Clock, without_gaps
from svfl_data.schema.rates import FEW, RATE_FACTOR
from svfl_data.storage.reader import EpisodeReader
from svfl_data.system.printable import printable
from svfl_models.cloning.gripper_view import projection
from svfl_models.cloning.recorded_inputs import recorded_input
from svfl_models.networks.action_space import PLANAR, ActionSpace

UNEVEN, OTHER_RATE = 1.1, 1.5
"""Ratios of the longest to the shortest step duration among episodes. Above `UNEVEN` a message is printed; above
`OTHER_RATE` the episodes count as recorded at different control rates."""
BLIND_SIDE = 76
"""Side of the image that a policy without image input is given and ignores, [px]: the image side of the simulation."""
LARGEST_SIDE = 4096
"""Largest allowed side of a camera image, [px]."""


@dataclass(frozen=True)
class DeploymentSpec:
    """What all demonstrations of a policy have in common, in plain values that are kept in the checkpoint.

    Attributes:
        task: Name of the task.
        camera: Name of the camera; empty if the policy has no image input.
        image_axes: Matrix from base (x, y) to image (right, up), 2 x 2.
        projection: Matrix from a homogeneous point in base axes, [m], to the camera's homogeneous pixel, 3 x 4
            (`gripper_view.projection`).
        centre: Centre of the workspace, base (x, y), [m].
        table: Height of the table in base axes, [m]: the lower bound of the workspace.
        image_side: Height and width of the camera's images, [px].
        depth_scale: Metres per unit of recorded depth, [m].
        step_ms: Time between two actions, [ms]; 0 if it is unknown.
        switch: Whether the gripper commands of all demonstrations are fully open or fully shut.
        max_move: Largest absolute dx, dy or dz of an action, [m].
        max_turn: Largest absolute dtheta of an action, [rad].
        inputs: Inputs of a policy whose inputs are the user's own, as plain values of
            `recorded_inputs.RecordedInput`; empty for the paper's inputs.
        action: Action of such a policy, as plain values of `networks.action_space.ActionSpace`; None for the planar
            action.
        robot: Name of the robot; empty if it was not recorded, or if there are several.
        wrench_hz: Rate of the wrench readings, [Hz]; 0 if the policy does not take the paper's wrench window, or the
            rate is unknown.
    """

    task: str
    camera: str = ""
    image_axes: list[list[float]] = field(default_factory=lambda: np.eye(2).tolist())
    projection: list[list[float]] = field(default_factory=lambda: np.eye(3, 4).tolist())
    centre: list[float] = field(default_factory=lambda: [0.0, 0.0])
    table: float = 0.0
    image_side: int = BLIND_SIDE
    depth_scale: float = 1e-4
    step_ms: float = 0.0
    switch: bool = False
    max_move: float = MAX_MOVE_M
    max_turn: float = MAX_TURN_RAD
    inputs: list[dict[str, Any]] = field(default_factory=list)
    action: dict[str, Any] | None = None
    robot: str = ""
    wrench_hz: float = 0.0

    def __post_init__(self) -> None:
        shapes = {"image_axes": (2, 2), "projection": (3, 4), "centre": (2,)}
        for name in (
            "image_axes",
            "projection",
            "centre",
            "table",
            "image_side",
            "depth_scale",
            "step_ms",
            "max_move",
            "max_turn",
            "wrench_hz",
        ):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape != shapes.get(name, ()) or not np.isfinite(values).all():
                raise TrainingError(f"{name} of a deployment setup cannot be {printable(getattr(self, name), 60)}")
        if self.image_side not in range(1, LARGEST_SIDE + 1) or not self.depth_scale > 0:
            raise TrainingError(
                f"image_side of a deployment setup is {self.image_side} px and depth_scale {self.depth_scale} m; "
                f"possible are sides of 1 to {LARGEST_SIDE} px and scales above 0"
            )
        if not (self.max_move > 0 and self.max_turn > 0):
            raise TrainingError(
                f"max_move of a deployment setup is {self.max_move} m and max_turn {self.max_turn} rad; both "
                "must be above 0"
            )

    def plain(self) -> dict[str, Any]:
        """Return the attributes as a dictionary of plain values for files."""
        return asdict(self)

    @property
    def unit(self) -> np.ndarray:
        """Factors from the network's action bounds (the paper's) to those of the demonstrations, shape (5,)."""
        return np.array(
            [1.0, *3 * [self.max_move / PLANAR.scale[1]], self.max_turn / PLANAR.scale[4]], dtype=np.float32
        )

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest action of the demonstrations, each of shape (5,), [-, m, m, m, rad]."""
        low, high = np.array(planar_action(self.max_move, self.max_turn).bounds).T
        return low, high


def deployment_of(
    dataset: Dataset, episodes: Sequence[int], camera: str | None = None, encoder: str = "vfp"
) -> DeploymentSpec:
    """Read what demonstrations have in common, as far as a policy depends on it.

    A policy without image input needs no camera: its vectors stay in base axes, and the attributes that describe images
    have default values.

    Args:
        dataset: Dataset to read the episodes from.
        episodes: Indices of the demonstrations, at least one.
        camera: Name of the camera whose images are used. May be None if the episodes have one camera.
        encoder: Inputs of the policy, one of `cloning.config.ENCODERS`.

    Raises:
        DatasetError: If the demonstrations differ in what a policy cannot observe: task, camera, workspace, control
            rate, rate of the wrench readings or action bounds.
        FieldError: If an episode lacks a field.
    """
    found = [(index, _of_episode(dataset.episode(index), camera, encoder)) for index in episodes]
    if not found:
        raise DatasetError(f"{dataset.path}: no episodes to learn from")
    (first, common), *others = found
    for index, other in others:
        for name, here in other.plain().items():
            there = common.plain()[name]
            if name not in ("switch", "step_ms", "robot", "wrench_hz") and here != there:
                raise DatasetError(
                    f"{dataset.path}: episode {index} has {name} {here}, episode {first} has {there}; "
                    "one policy learns from demonstrations of one task, camera, workspace and kind of action"
                )
    step_ms = _period({index: one.step_ms for index, one in found if one.step_ms}, dataset)
    wrench_hz = _wrench_hz({index: one.wrench_hz for index, one in found if one.wrench_hz}, dataset)
    robot, switch = _robot(one.robot for _, one in found), all(one.switch for _, one in found)
    return replace(common, step_ms=step_ms, wrench_hz=wrench_hz, robot=robot, switch=switch)


def deployment_of_own(
    dataset: Dataset, episodes: Sequence[int], words: Sequence[str], action: str, symmetric: bool
) -> DeploymentSpec:
    """Read what demonstrations have in common, for a policy with inputs and an action of the user's own.

    Vectors are learned in the axes of the images of the fixed cameras, which must all be the same.

    Args:
        dataset: Dataset to read the episodes from.
        episodes: Indices of the demonstrations, at least one.
        words: Inputs of the policy, see `recorded_inputs.recorded_input`.
        action: Path of the action.
        symmetric: Whether the network is symmetric.

    Raises:
        UsageError: If there is no such input or action, or an input is named twice.
        DatasetError: If the demonstrations differ in their task or control rate.
        TrainingError: If a symmetric network cannot take an input or the action.
    """
    readers = [dataset.episode(index) for index in episodes]
    first = readers[0]
    inputs = [recorded_input(one, first, symmetric) for one in words]
    if len({one.path for one in inputs}) < len(inputs):
        raise UsageError(f"an input is named twice: {', '.join(words)}")
    declared = first.declarations.at(action)
    if declared is None or not all(action in reader for reader in readers) or not action.startswith("actions/"):
        known = ", ".join(path for path in first.paths if path.startswith("actions/"))
        raise UsageError(f"{first.extent}: no action {action!r}; there are {known}")
    space = ActionSpace.of(declared, symmetric)
    tasks = sorted({reader.meta.task for reader in readers})
    if len(tasks) > 1:
        raise DatasetError(f"{dataset.path}: one policy learns from demonstrations of one task, found {tasks}")
    seen = [one.path for one in inputs if one.kind == "image" and one.moves == "pixels"]
    axes = [np.round(first[f"{path}/image_axes"][:], 9).tolist() for path in seen]
    if any(one != axes[0] for one in axes):
        raise DatasetError(
            f"{first.extent}: {' and '.join(seen)} have different image axes, so their images do not turn alike; "
            f"take one of them as {seen[1]}:invariant"
        )
    opened = [reader[action][:][:, space.opening] for reader in readers] if space.opening is not None else []
    medians = {index: np.median(np.diff(reader["observations/t_ns"][:])) / 1e6 for index, reader in
               zip(episodes, readers, strict=True) if len(reader)}  # fmt: skip
    return DeploymentSpec(
        task=tasks[0],
        robot=_robot(reader.meta.robot for reader in readers),
        image_axes=axes[0] if axes else np.eye(2).tolist(),
        step_ms=_period({index: float(step) for index, step in medians.items()}, dataset),
        switch=bool(opened) and all(np.isin(values, (0, 1)).all() for values in opened),
        inputs=[one.plain() for one in inputs],
        action=space.plain(),
    )


def _of_episode(reader: EpisodeReader, camera: str | None, encoder: str) -> DeploymentSpec:
    action = reader.declarations.at(ACTION)
    assert action is not None
    max_move, max_turn = planar_limits(action)
    seen = _seen(reader, camera) if "v" in encoder else {}
    return replace(
        DeploymentSpec(task=reader.meta.task, robot=reader.meta.robot, max_move=max_move, max_turn=max_turn),
        **seen,
        centre=np.round(reader["workspace"][:2].mean(axis=1), 9).tolist() if "p" in encoder else [0.0, 0.0],
        step_ms=float(np.median(np.diff(reader["observations/t_ns"][:])) / 1e6) if len(reader) else 0.0,
        switch=bool(np.isin(reader["actions/action"][:][:, 0], (0, 1)).all()),
        wrench_hz=_found_hz(reader, "streams/wrench") if "f" in encoder else 0.0,
    )


def _found_hz(reader: EpisodeReader, group: str) -> float:
    """Return the rate of a stream, [Hz], as declared or else as recorded; 0 for fewer than `FEW` readings."""
    clock, t_ns = Clock.of(reader.meta, group), reader[f"{group}/t_ns"][:]
    return clock.rate_hz or (without_gaps(t_ns, clock.gaps).rate_hz if len(t_ns) >= FEW else 0.0)


def _robot(names: Iterable[str]) -> str:
    """Return the name of the only robot; an empty name if there are several."""
    found = set(names)
    return found.pop() if len(found) == 1 else ""


def _seen(reader: EpisodeReader, camera: str | None) -> dict[str, Any]:
    """Return the attributes of a `DeploymentSpec` that describe the images of an episode."""
    name = named_camera(reader.cameras, camera, reader.extent)
    height, width = reader[f"cameras/{name}/depth"].shape[1:]
    if height != width:
        raise DatasetError(f"{reader.extent}: images of {name} are {height} x {width} px; needed: square ones")
    return {
        "camera": name,
        "image_axes": np.round(reader[f"cameras/{name}/image_axes"][:], 9).tolist(),
        "projection": np.round(_projection(reader, name), 6).tolist(),
        "table": round(float(reader["workspace"][:][2, 0]), 9),
        "image_side": int(height),
        "depth_scale": float(reader[f"cameras/{name}/depth_scale"][()]),
    }


def _projection(reader: EpisodeReader, camera: str) -> np.ndarray:
    return projection(*(reader[f"cameras/{camera}/{name}"][:] for name in ("intrinsics", "T_base_camera")))


def _period(step_ms: Mapping[int, float], dataset: Dataset) -> float:
    """Return the median of the episodes' median step durations, [ms]; 0 if no episode has a step."""
    if not step_ms:
        return 0.0
    (slow, longest), (quick, shortest) = _extremes(step_ms)
    usual = float(np.median(list(step_ms.values())))
    if longest > OTHER_RATE * shortest:
        raise DatasetError(
            f"{dataset.path}: episode {slow} has step_ms {longest:.1f}, episode {quick} has {shortest:.1f}; one policy "
            "learns from demonstrations of one control rate: an action is a displacement per step"
        )
    if longest > UNEVEN * shortest:
        print(
            f"{dataset.path}: steps last {shortest:.1f} to {longest:.1f} ms in different episodes. A policy does not "
            f"get these times; call it every {usual:.0f} ms, the median of the demonstrations",
            file=sys.stderr,
        )
    return usual


def _wrench_hz(rates_hz: Mapping[int, float], dataset: Dataset) -> float:
    """Return the median of the rates of the wrench readings, [Hz]; 0 if no episode has one."""
    if not rates_hz:
        return 0.0
    (quick, highest), (slow, lowest) = _extremes(rates_hz)
    if highest > RATE_FACTOR * lowest:
        raise DatasetError(
            f"{dataset.path}: episode {quick} has wrench readings at {highest:.4g} Hz, episode {slow} at {lowest:.4g} "
            "Hz; one policy learns from wrench windows of one rate"
        )
    return float(np.median(list(rates_hz.values())))


def _extremes(values: Mapping[int, float]) -> tuple[tuple[int, float], tuple[int, float]]:
    """Return episode and value of the largest and of the smallest value."""
    return max(values.items(), key=itemgetter(1)), min(values.items(), key=itemgetter(1))
