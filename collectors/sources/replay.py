"""Repeated simulation of a recorded episode from its configuration, seed and actions, and comparison of both."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from collectors.recording.collection import software_versions
from collectors.recording.loop import OBJECT, record
from collectors.robots import recorded_class
from collectors.simulation.arms.arm import RobotConfig
from collectors.simulation.centering import CenteringConfig
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.sources import centering
from collectors.sources.simulated import VERSIONS
from collectors.tasks import TASKS, task_class
from collectors.tasks.task import attempt_seed
from svfl_data.errors import DatasetError, FormatError, UsageError
from svfl_data.schema.episode import Episode, Meta, canonical_json
from svfl_data.system.printable import printable

Config = TypeVar("Config")
State = Callable[[], Mapping[str, np.ndarray]]
Number = Annotated[int, msgspec.Meta(ge=0)]


class Recorded(msgspec.Struct):
    """Part of a simulated episode's configuration that determines its scene.

    Attributes:
        attempt: Number of the attempt, from 0.
        index: Number that the episode was made with. None means that the configuration does not hold that number, and
            the episode's history or its number in the dataset tells it.
    """

    attempt: Number
    index: Number | None = None


class CameFrom(msgspec.Struct):
    """Place from which a tool took an episode.

    Attributes:
        index: Number of the episode in the dataset from which it was taken.
    """

    index: Number


class Change(msgspec.Struct):
    """Entry of an episode's history, which says what a tool did to the episode.

    Attributes:
        came_from: Place from which the tool took the episode. None if the tool did not take it from another dataset.
    """

    came_from: CameFrom | None = None


@dataclass(frozen=True)
class Replayed:
    """Result of the comparison of an episode with its second simulation.

    Attributes:
        differences: Largest absolute difference in every array, in the array's unit, by path in the episode file. It is
            infinite for an array that the episode lacks or that has another shape.
        scene: Whether the second simulation drew the same scene.
        versions: Recorded and installed version, by name, of every package whose two versions differ.
    """

    differences: dict[str, float]
    scene: bool
    versions: dict[str, tuple[str, str]]

    @property
    def exact(self) -> bool:
        """Whether the scene and all arrays are the same."""
        return self.scene and not any(self.differences.values())


def replay(episode: Episode, robot: RobotConfig | None = None) -> Replayed:
    """Simulate an episode again and compare it with the record.

    Args:
        episode: Episode that was recorded in this simulation.
        robot: Robot that executes the recorded actions. None means the robot of the episode.

    Raises:
        DatasetError: If the episode does not come from this simulation.
        FormatError: If the episode's configuration cannot be read, or does not fit the recorded arrays.
    """
    meta = episode.meta
    if "world" not in meta.config or "attempt" not in meta.config:
        raise DatasetError(
            f"{episode.name}: not recorded in this simulation (source {meta.source!r}); nothing to replay"
        )
    config = from_json(WorldConfig, _with_robot(meta.config["world"]), f"{episode.name}: config.world")
    _refuse_more_than_recorded(episode, config)
    if robot:
        config = replace(config, robot=robot)
    actions = iter(episode.action)
    with World(config) as world:
        state, drawn = _begin(meta, world, episode.name)
        again = record(world, lambda _: next(actions, None), len(episode), state=state)
    installed = software_versions(*VERSIONS)
    return Replayed(
        {path: _difference(episode.arrays.get(path), values) for path, values in sorted(again.items())},
        json.loads(canonical_json(drawn)) == meta.config.get("drawn"),
        {
            name: (printable(meta.software.get(name), 50), version)
            for name, version in installed.items()
            if meta.software.get(name) != version
        },
    )


def _with_robot(world: Any) -> Any:  # noqa: ANN401 - any JSON value
    """Name the robot in a world's configuration that was recorded when the Panda was the only robot."""
    if not (isinstance(world, dict) and isinstance(world.get("panda"), dict) and "robot" not in world):
        return world
    others = {name: value for name, value in world.items() if name != "panda"}
    return others | {"robot": {"name": "panda_sim", **world["panda"]}}


def _begin(meta: Meta, world: World, where: str) -> tuple[State, dict[str, Any]]:
    """Set up an episode's scene, and return the function that reads the true state, and the scene as drawn."""
    index, attempt = _index(meta, where), from_json(Recorded, meta.config, f"{where}: config").attempt
    if meta.seed < 0:
        raise FormatError(f"{where}: seed {meta.seed} is below 0; those of simulated episodes are at least 0")
    if meta.task == centering.TASK:
        config = from_json(CenteringConfig, meta.config.get("scene"), f"{where}: config.scene")
        scene, block = centering.begin(world, config, meta.seed, index, attempt)
        return lambda: {OBJECT: world.pose(block)}, asdict(scene)
    if meta.task not in TASKS:
        raise DatasetError(
            f"{where}: no task {printable(meta.task)!r} here; the tasks are {', '.join([centering.TASK, *TASKS])}"
        )
    task = task_class(meta.task).begin(world, attempt_seed(meta.seed, index, attempt))
    return task.state, task.drawn()


def _refuse_more_than_recorded(episode: Episode, config: WorldConfig) -> None:
    """Refuse to simulate more than the file holds, because a bad configuration could ask for any number of steps."""
    readings = len(episode.arrays.get("streams/wrench/t_ns", ()))
    asked = (config.settle_steps + len(episode)) * config.physics_steps
    if asked > readings:
        raise FormatError(f"{episode.name}: config.world makes {asked} readings or more, the file has {readings}")
    made = {name: (camera.height, camera.width) for name, camera in config.cameras.items()}
    seen = {name: camera.color.shape[1:3] for name, camera in episode.cameras.items()}
    if made != seen:
        raise FormatError(
            f"{episode.name}: config.world has cameras {printable(made)}, the file pictures of {printable(seen)}"
        )


def _index(meta: Meta, where: str) -> int:
    """Return the number that an episode was made with, which a merge may have changed since."""
    own = from_json(Recorded, meta.config, f"{where}: config").index
    if own is not None:
        return own
    changes = [from_json(Change, entry, f"{where}: history") for entry in meta.history]
    return next((change.came_from.index for change in changes if change.came_from), meta.index)


def _difference(recorded: np.ndarray | None, again: np.ndarray) -> float:
    if recorded is None or recorded.shape != again.shape:
        return np.inf
    if not again.size:
        return 0.0
    return float(np.abs(recorded.astype(np.float64) - again.astype(np.float64)).max())


def from_json(kind: type[Config], values: Any, where: str) -> Config:  # noqa: ANN401 - any JSON value
    """Return a configuration from its JSON values. A field that the values lack has its default.

    Args:
        kind: Class of the configuration: a dataclass with declared bounds (`collectors.simulation.bounds`) or a
            `msgspec.Struct`.
        values: JSON values that `dataclasses.asdict` made of a configuration.
        where: Place of the values, such as an episode's name and a path, for error messages.

    Raises:
        FormatError: If the values are no configuration of that class, or are out of bounds.
    """
    try:
        read = msgspec.convert(values, kind, dec_hook=_robot)
    except (msgspec.ValidationError, UsageError) as error:
        raise FormatError(f"{where}: {printable(error)}") from None
    if is_dataclass(read):
        _refuse_unknown(read, values, where)
    return read


def _robot(kind: type, values: Any) -> RobotConfig:  # noqa: ANN401
    """Return a robot's configuration from its JSON values, which name the robot."""
    assert kind is RobotConfig, kind
    read: RobotConfig = msgspec.convert(values, recorded_class(values))
    return read


def _refuse_unknown(read: Any, values: dict[str, Any], where: str) -> None:  # noqa: ANN401
    """Refuse names that a dataclass, or a dataclass inside it, lacks, because they had a meaning when recorded."""
    unknown = sorted(values.keys() - {field.name for field in fields(read)})
    if unknown:
        named = printable(", ".join(unknown))
        raise FormatError(f"{where}: this software does not know {named}; was it another version?")
    for name, value in values.items():
        inside = getattr(read, name)
        if is_dataclass(inside):
            _refuse_unknown(inside, value, f"{where}.{name}")
        elif isinstance(inside, dict):
            for key, member in inside.items():
                _refuse_unknown(member, value[key], printable(f"{where}.{name}.{key}"))
