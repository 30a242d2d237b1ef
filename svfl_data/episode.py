"""One episode in memory: from reset to end, every array with one fixed meaning."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from svfl_data.fields import FIELD, check_arrays


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
    """

    task: str
    index: int
    seed: int
    source: str
    success: bool
    config: dict[str, Any] = field(default_factory=dict)
    software: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Episode:
    """The arrays and metadata of one episode; the arrays are those declared in `svfl_data.fields.FIELDS`.

    Attributes:
        meta: What the episode is about.
        arrays: Field name to array, checked and read-only. Also available as attributes: ``episode.wrench``.
        name: Where it came from, for messages.
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
            array.setflags(write=False)

    def __getattr__(self, name: str) -> np.ndarray:
        arrays = self.__dict__.get("arrays", {})
        if name in arrays:
            return arrays[name]
        if name in FIELD:
            raise AttributeError(f"{self.name} was recorded without {FIELD[name].path}")
        raise AttributeError(f"an episode has no {name!r}; it has {', '.join(FIELD)}")

    def __len__(self) -> int:
        return len(self.action)

    def __repr__(self) -> str:
        seconds = (self.t_ns[-1] - self.t_ns[0]) / 1e9
        shapes = ", ".join(f"{name} {array.shape}" for name, array in self.arrays.items() if array.ndim)
        return f"Episode({self.meta.task} {self.meta.index}, {len(self)} steps, {seconds:.2f} s: {shapes})"

    @property
    def centre(self) -> np.ndarray:
        """Centre of the workspace and of the image, base (x, y), shape (2,), [m]."""
        return np.asarray(self.workspace[:2].mean(axis=1))

    @property
    def tared_wrench(self) -> np.ndarray:
        """The whole wrench stream minus the tare, shape (M, 6), [N] and [N m], base axes, about the sensor origin."""
        return np.asarray(self.wrench - self.tare, dtype=np.float32)

    @property
    def depth_m(self) -> np.ndarray:
        """Depth images in metres, shape (N+1, H, W), float32; 0 where there is no measurement."""
        return np.asarray(self.depth * np.float32(self.depth_scale), dtype=np.float32)


def canonical_json(value: Any) -> str:  # noqa: ANN401 - any JSON value
    """JSON text that is the same for equal values, so that equal episodes are equal bytes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
