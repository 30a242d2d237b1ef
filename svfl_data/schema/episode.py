"""One episode in memory, from reset to end, in which every array has one fixed meaning."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.fields import CAMERA, FIELDS, camera_names
from svfl_data.schema.validity import check_arrays
from svfl_data.system.printable import printable
from svfl_data.system.side_files import plain

NAMED = {field.name: field.path for field in FIELDS if CAMERA not in field.path}
"""Path of each standard field that does not belong to a camera, by its name as an attribute of an episode."""
OF_CAMERA = {field.name: field for field in FIELDS if CAMERA in field.path}


@dataclass(frozen=True)
class Meta:
    """Metadata of an episode, which are the facts about it besides its arrays.

    Attributes:
        task: Name of the task, e.g. ``centering``.
        index: Index of the episode in its dataset.
        seed: Seed of the dataset. Together with `index` it determines a simulated episode.
        source: Who chose the actions: ``expert``, ``teleop``, ``policy`` or ``robot``.
        success: Whether the task was achieved.
        instruction: What was to be done, in words, e.g. ``put the cup on the plate``; empty if not given.
        robot: Name of the robot, e.g. ``panda_sim``; empty if unknown.
        operator: Who operated the robot, as far as it may be published; empty if unknown or without an operator.
        config: Everything that was set when recording, as JSON values.
        software: Versions of the packages that recorded the episode, by package name.
        transforms: Transforms that turn raw streams into usable ones (tare, filter, compensation), each with its
            parameters, in the order in which they are applied.
        annotations: Named intervals of the episode clock, e.g. contacts, each with who found it and how.
        history: Faults and late readings of the recording, and what tools have done to the episode since it was
            recorded, oldest first.

    Example:
        >>> Meta("wiping", index=0, seed=0, source="teleop", success=True).task
        'wiping'
    """

    task: str
    index: int
    seed: int
    source: str
    success: bool
    config: dict[str, Any] = field(default_factory=dict)
    software: dict[str, str] = field(default_factory=dict)
    transforms: list[dict[str, Any]] = field(default_factory=list)
    annotations: list[dict[str, Any]] = field(default_factory=list)
    history: list[dict[str, Any]] = field(default_factory=list)
    instruction: str = ""
    robot: str = ""
    operator: str = ""


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera of an episode; its arrays are those declared for cameras in `svfl_data.schema.fields.FIELDS`.

    Attributes:
        name: Name of the camera.
        arrays: Recorded arrays of the camera by the last part of their paths. Each array is also an attribute of the
            camera: ``camera.color``.

    Example:
        >>> camera = dataset[0].cameras["front"]
        >>> camera.color.shape, camera.has("depth")
        ((21, 16, 16, 3), True)
    """

    name: str
    arrays: dict[str, np.ndarray]

    def __getattr__(self, name: str) -> np.ndarray:
        return _array(self, self.__dict__.get("arrays", {}), name, name, f"camera {self.__dict__.get('name')}")

    def has(self, name: str) -> bool:
        """Return whether an optional field of the camera was recorded.

        Args:
            name: Name of the field, such as ``depth``.
        """
        return name in self.arrays

    @property
    def depth_m(self) -> np.ndarray:
        """Depth images, shape (F, H, W), float32, [m]; 0 where there is no measurement."""
        return np.asarray(np.asarray(self.depth) * np.float32(self.depth_scale), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Episode:
    """The arrays and metadata of one episode; the arrays are those declared in `svfl_data.schema.fields.FIELDS`.

    Attributes:
        meta: Metadata of the episode.
        arrays: Arrays of the episode by dataset path, checked and read-only. Each standard array that does not belong
            to a camera is also an attribute of the episode: ``episode.wrench``.
        name: Name of the episode in messages, such as the file that it was read from.
        declarations: Declarations of the arrays. Only the user's own fields, and another action than the planar one,
            must be given.

    Example:
        >>> episode = dataset[0]
        >>> episode.action.shape, episode.wrench.shape, list(episode.cameras)
        ((20, 5), (600, 6), ['front'])
    """

    meta: Meta
    arrays: dict[str, np.ndarray]
    name: str = "episode"
    declarations: Declarations = STANDARD

    def __post_init__(self) -> None:
        """Check every array against its declaration and make the array read-only.

        Raises:
            FieldError: If an array does not fit its declaration.
        """
        check_arrays(self.arrays, self.name, self.declarations)
        for array in self.arrays.values():
            if isinstance(array, np.ndarray):  # images may still be on disk (`EpisodeReader.load`)
                array.setflags(write=False)

    def __getattr__(self, name: str) -> np.ndarray:
        path = NAMED.get(name)
        return _array(self, self.__dict__.get("arrays", {}), name, path, self.__dict__.get("name", "episode"))

    def __getitem__(self, path: str) -> np.ndarray:
        """Return the array at a dataset path, whether it is a standard one or the user's own.

        Raises:
            MissingField: If the episode was recorded without it.
        """
        if path not in self.arrays:
            raise MissingField(f"{self.name} was recorded without {path}")
        return self.arrays[path]

    def has(self, name: str) -> bool:
        """Return whether a standard field, or an array of the user's own, was recorded.

        Args:
            name: Name of the field, such as ``joints``, or dataset path. Names of camera fields are not among them (see
                `Camera.has`).
        """
        return NAMED.get(name, name) in self.arrays

    def __len__(self) -> int:
        return len(self.t_ns) - 1

    def __repr__(self) -> str:
        seconds = (self.t_ns[-1] - self.t_ns[0]) / 1e9
        lines = [f"Episode {self.meta.index} of {self.meta.task}: {len(self)} steps, {seconds:.2f} s"]
        lines += [f"  {path} {array.dtype} {array.shape}" for path, array in self.arrays.items()]
        return "\n".join(map(printable, lines))

    @property
    def cameras(self) -> dict[str, Camera]:
        """The cameras of the episode by name."""
        found: dict[str, dict[str, np.ndarray]] = {camera: {} for camera in camera_names(self.arrays)}
        for path, array in self.arrays.items():
            group, _, leaf = path.rpartition("/")
            if group.startswith("cameras/"):
                found[group.partition("/")[2]][leaf] = array
        return {camera: Camera(camera, arrays) for camera, arrays in found.items()}

    @property
    def centre(self) -> np.ndarray:
        """Centre of the workspace, base (x, y), shape (2,), [m]."""
        return np.asarray(self.workspace[:2].mean(axis=1))

    @property
    def tared_wrench(self) -> np.ndarray:
        """Wrench readings minus the tare, shape (M, 6), float32, [N] and [N m], base axes, about the sensor origin."""
        return np.asarray(self.wrench - self.tare, dtype=np.float32)


class MissingField(FieldError, AttributeError):  # noqa: N818 - the recording's fact, not necessarily a mistake
    """An array was asked for that the episode was recorded without.

    Example:
        >>> try:
        ...     dataset[0]["streams/tactile/pressure"]
        ... except MissingField as error:
        ...     print("tactile" in str(error))
        True
    """


def _array(owner: Episode | Camera, arrays: dict[str, Any], name: str, key: str | None, where: str) -> np.ndarray:
    """Return an array for ``__getattr__``, or raise an error that says which arrays there are."""
    failed = getattr(type(owner), name, None)
    if isinstance(failed, property):  # an array that the property needs is missing; calling it again raises that error
        return np.asarray(failed.__get__(owner))
    if key in arrays:
        found: np.ndarray = arrays[key]  # or a `StoredArray`, which is indexed like an array
        return found
    known = OF_CAMERA if isinstance(owner, Camera) else NAMED
    if name not in known:
        raise AttributeError(f"{type(owner).__name__} has no {name!r}; it has {', '.join(known)}")
    raise MissingField(f"{where} was recorded without {key}")


def canonical_json(value: Any) -> str:  # noqa: ANN401 - any JSON value
    """Return JSON text that is the same for equal values, so that equal episodes give equal bytes.

    Args:
        value: Value made of JSON types, NumPy scalars, arrays and tuples.

    Raises:
        FieldError: If the value cannot be stored as JSON (`side_files.plain`).
    """
    made = plain(value, "value")
    return json.dumps(made, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
