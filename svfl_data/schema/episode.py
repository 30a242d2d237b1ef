"""One episode in memory: from reset to end, every array with one fixed meaning."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from svfl_data.schema.fields import CAMERA, OF_CAMERA, OF_EPISODE, camera_names
from svfl_data.schema.validity import check_arrays
from svfl_data.system.printable import printable
from svfl_data.system.side_files import plain


@dataclass(frozen=True)
class Meta:
    """What an episode is about, beside its arrays.

    Attributes:
        task: Name of the task, e.g. ``centering``.
        index: Position in its dataset.
        seed: Seed of the dataset; with `index` it determines a simulated episode.
        source: Who acted: ``expert``, ``teleop``, ``policy`` or ``robot``.
        success: Whether the task was achieved.
        config: Everything that was set when recording (JSON values).
        software: Versions of what recorded it, by package.
        transforms: How raw streams become usable ones (tare, filter, compensation), with parameters, in order.
        annotations: Named intervals of the episode clock, e.g. contacts, with who found them and how.
        history: What tools have done to the episode since it was recorded, oldest first.

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


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera of an episode; its arrays are those declared for cameras in `svfl_data.schema.fields.FIELDS`.

    Attributes:
        name: Its name.
        arrays: Field name to array. Also available as attributes: ``camera.color``.

    Example:
        >>> camera = dataset[0].cameras["front"]
        >>> camera.color.shape, camera.has("depth")
        ((21, 16, 16, 3), True)
    """

    name: str
    arrays: dict[str, np.ndarray]

    def __getattr__(self, name: str) -> np.ndarray:
        return _array(self, OF_CAMERA, name, f"camera {self.__dict__.get('name')}")

    def has(self, name: str) -> bool:
        """Whether an optional field was recorded."""
        return name in self.arrays

    @property
    def depth_m(self) -> np.ndarray:
        """Depth images in metres, shape (F, H, W), float32; 0 where there is no measurement."""
        return np.asarray(np.asarray(self.depth) * np.float32(self.depth_scale), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Episode:
    """The arrays and metadata of one episode; the arrays are those declared in `svfl_data.schema.fields.FIELDS`.

    Attributes:
        meta: What the episode is about.
        arrays: Dataset path to array, checked and read-only. Those that do not belong to a camera are also available
            by name as attributes: ``episode.wrench``.
        name: Where it came from, for messages.

    Example:
        >>> episode = dataset[0]
        >>> episode.action.shape, episode.wrench.shape, list(episode.cameras)
        ((20, 5), (600, 6), ['front'])
    """

    meta: Meta
    arrays: dict[str, np.ndarray]
    name: str = "episode"

    def __post_init__(self) -> None:
        """Check every array against its declaration and lock it.

        Raises:
            FieldError: If an array does not fit its declaration.
        """
        check_arrays(self.arrays, self.name)
        for array in self.arrays.values():
            if isinstance(array, np.ndarray):  # images may still lie on disk (`EpisodeReader.load`)
                array.setflags(write=False)

    def __getattr__(self, name: str) -> np.ndarray:
        return _array(self, OF_EPISODE, name, self.__dict__.get("name", "episode"))

    def has(self, name: str) -> bool:
        """Whether an optional field was recorded."""
        return OF_EPISODE[name].path in self.arrays

    def __len__(self) -> int:
        return len(self.action)

    def __repr__(self) -> str:
        seconds = (self.t_ns[-1] - self.t_ns[0]) / 1e9
        lines = [f"Episode {self.meta.index} of {self.meta.task}: {len(self)} steps, {seconds:.2f} s"]
        lines += [f"  {path} {array.dtype} {array.shape}" for path, array in self.arrays.items()]
        return "\n".join(map(printable, lines))

    @property
    def cameras(self) -> dict[str, Camera]:
        """The cameras, by name."""
        return {
            camera: Camera(
                camera,
                {
                    name: self.arrays[path]
                    for name, declared in OF_CAMERA.items()
                    if (path := declared.path.replace(CAMERA, camera)) in self.arrays
                },
            )
            for camera in camera_names(self.arrays)
        }

    @property
    def centre(self) -> np.ndarray:
        """Centre of the workspace, base (x, y), shape (2,), [m]."""
        return np.asarray(self.workspace[:2].mean(axis=1))

    @property
    def tared_wrench(self) -> np.ndarray:
        """The whole wrench stream minus the tare, shape (M, 6), [N] and [N m], base axes, about the sensor origin."""
        return np.asarray(self.wrench - self.tare, dtype=np.float32)


def _array(owner: Episode | Camera, fields: dict[str, Any], name: str, where: str) -> np.ndarray:
    """Look an array up for ``__getattr__``, with an error that says what there is."""
    failed = getattr(type(owner), name, None)
    if isinstance(failed, property):  # Python asks here when a property lacks what it is made from; that is the error
        return np.asarray(failed.__get__(owner))
    arrays = owner.__dict__.get("arrays", {})
    if name not in fields:
        raise AttributeError(f"{type(owner).__name__} has no {name!r}; it has {', '.join(fields)}")
    key = name if isinstance(owner, Camera) else fields[name].path
    if key not in arrays:
        raise AttributeError(f"{where} was recorded without {fields[name].path}")
    found: np.ndarray = arrays[key]  # or a `StoredArray`, which gives rows as one does
    return found


def canonical_json(value: Any) -> str:  # noqa: ANN401 - any JSON value
    """JSON text that is the same for equal values, so that equal episodes are equal bytes.

    Raises:
        FieldError: If the value cannot be stored as JSON (`side_files.plain`).
    """
    made = plain(value, "value")
    return json.dumps(made, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
