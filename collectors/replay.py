"""A recorded episode once more: from its configuration, seed and actions to the same numbers."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from collectors import centering
from collectors.dataset import software_versions
from collectors.record import OBJECT, record
from collectors.simulated import VERSIONS, attempt_seed
from collectors.simulation.centering import CenteringConfig
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.tasks import TASKS, task_class
from svfl_data.episode import Episode, Meta, canonical_json
from svfl_data.errors import DatasetError, FormatError

Config = TypeVar("Config")
State = Callable[[], Mapping[str, np.ndarray]]


@dataclass(frozen=True)
class Replayed:
    """How an episode and its re-simulation compare.

    Attributes:
        differences: Largest absolute difference of every array, in its unit, by dataset path; infinite where shapes
            differ.
        scene: Whether the same scene was drawn.
        versions: What was recorded with another version than is installed: package to recorded and installed one.
    """

    differences: dict[str, float]
    scene: bool
    versions: dict[str, tuple[str, str]]

    @property
    def exact(self) -> bool:
        """Whether everything is the same."""
        return self.scene and not any(self.differences.values())


def replay(episode: Episode) -> Replayed:
    """Simulate an episode again and compare.

    Raises:
        DatasetError: If it does not come from this simulation.
        FormatError: If its configuration cannot be read.
    """
    meta = episode.meta
    if "world" not in meta.config or "attempt" not in meta.config:
        raise DatasetError(
            f"{episode.name}: not recorded in this simulation (source {meta.source!r}); nothing to replay"
        )
    actions = iter(episode.action)
    with World(from_json(WorldConfig, meta.config["world"], f"{episode.name}: config.world")) as world:
        state, drawn = _begin(meta, world, episode.name)
        again = record(world, lambda _: next(actions, None), len(episode), state=state)
    installed = software_versions(*VERSIONS)
    return Replayed(
        {path: _difference(episode.arrays.get(path), values) for path, values in sorted(again.items())},
        json.loads(canonical_json(drawn)) == meta.config.get("drawn"),
        {
            name: (str(meta.software.get(name)), version)
            for name, version in installed.items()
            if meta.software.get(name) != version
        },
    )


def _begin(meta: Meta, world: World, where: str) -> tuple[State, dict[str, Any]]:
    """Set the episode's scene up; returns how to read the true state, and the scene."""
    index, attempt = _index(meta), meta.config["attempt"]
    if meta.task == centering.TASK:
        config = from_json(CenteringConfig, meta.config["scene"], f"{where}: config.scene")
        scene, block = centering.begin(world, config, meta.seed, index, attempt)
        return lambda: {OBJECT: world.pose(block)}, asdict(scene)
    if meta.task not in TASKS:
        raise DatasetError(f"{where}: no task {meta.task!r} here; the tasks are {', '.join([centering.TASK, *TASKS])}")
    task = task_class(meta.task).begin(world, attempt_seed(meta.seed, index, attempt))
    return task.state, task.drawn()


def _index(meta: Meta) -> int:
    """The number that an episode was made with, whatever number merging gave it since."""
    moved = [entry["came_from"]["index"] for entry in meta.history if "came_from" in entry]
    found: int = meta.config.get("index", moved[0] if moved else meta.index)
    return found


def _difference(recorded: np.ndarray | None, again: np.ndarray) -> float:
    if recorded is None or recorded.shape != again.shape:
        return np.inf
    if not again.size:
        return 0.0
    return float(np.abs(recorded.astype(np.float64) - again.astype(np.float64)).max())


def from_json(kind: type[Config], values: Any, where: str) -> Config:  # noqa: ANN401 - any JSON value
    """A configuration from its JSON values; what is not there has its default.

    Args:
        kind: A dataclass of numbers, strings, tuples, dataclasses, and dicts of those by name.
        values: What `dataclasses.asdict` and JSON made of one.
        where: What to name in the error.

    Raises:
        FormatError: If it is something else.
    """
    hints = get_type_hints(kind)
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    unknown = values.keys() - names if isinstance(values, dict) else {"(not an object)"}
    if unknown:
        raise FormatError(f"{where}: this software does not know {', '.join(sorted(unknown))}; was it a newer one?")
    return kind(**{name: _value(hints[name], value, f"{where}.{name}") for name, value in values.items()})


def _value(kind: Any, value: Any, where: str) -> Any:  # noqa: ANN401
    if is_dataclass(kind) and isinstance(kind, type):
        return from_json(kind, value, where)
    if get_origin(kind) is dict and isinstance(value, dict):
        return {name: _value(get_args(kind)[1], item, f"{where}.{name}") for name, item in value.items()}
    return _tuple(value)


def _tuple(value: Any) -> Any:  # noqa: ANN401
    return tuple(map(_tuple, value)) if isinstance(value, list) else value
