"""Specification of a replay buffer with any inputs and any action, whose values stay as they were recorded."""

from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from typing import Any

import msgspec
import numpy as np

from svfl_data.errors import FieldError, UsageError
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.episode_builder import finite
from svfl_data.replay.specs.layout import Array, Layout
from svfl_data.replay.specs.recorded_inputs import RecordedInputs
from svfl_data.replay.specs.recorded_layout import LONGEST, layout_of
from svfl_data.replay.specs.spec import Observation, Spec, difference
from svfl_data.sampling.batch import age_key, axes_key, padding_key
from svfl_data.schema.action_bounds import ActionBounds
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import LARGEST, Field, field_fault
from svfl_data.schema.input_spec import ACTIONS, InputSpec
from svfl_data.signals.camera_poses import moves

CAMERA_FACTS = ("intrinsics", "T_base_camera", "T_tcp_camera", "image_axes", "depth_scale")
COMPARED = ("dtype", "shape", "unit", "axes", "about", "components", "parts", "bounds", "delta", "image")
"""Attributes of a declaration that must be equal for episodes to be mixed in one batch."""


@dataclass(frozen=True)
class RecordedSpec(RecordedInputs):
    """Properties that must be equal for transitions of different episodes to be mixed in one batch.

    The keys of batches are those of `svfl_data.sampling.samples.Samples`, and so are the values: as recorded, in base
    axes, images as integers.
    """

    @classmethod
    def of_episode(
        cls, episode: Episode, inputs: InputSpec, action: str = "actions/action", invariant: Collection[str] = ()
    ) -> "RecordedSpec":
        """Return the spec of a recorded episode.

        Args:
            episode: Recorded episode.
            inputs: What is taken at each observation.
            action: Path of the action.
            invariant: Paths of inputs, or ``cameras/NAME``, that stay when a transition is rotated.

        Raises:
            FieldError: If the episode lacks an array or a camera, or an array holds no numbers.
            UsageError: If `invariant` names something that is not an input, or a path is of another kind.
        """
        paths = [*inputs.windows, *inputs.vectors, action]
        for camera in inputs.cameras:
            images = episode.declarations.image_paths(camera, episode.arrays)
            if not images:
                known = ", ".join(episode.cameras) or "none"
                raise FieldError(f"{episode.name}: no images of a camera {camera!r}; there are the cameras {known}")
            paths += images
        if not action.startswith(ACTIONS):
            raise UsageError(f"{action} is not below {ACTIONS}")
        named = {*inputs.windows, *inputs.vectors, *(f"cameras/{camera}" for camera in inputs.cameras)}
        if unknown := set(invariant) - named:
            raise UsageError(f"invariant names {min(unknown)}, but the inputs are {', '.join(sorted(named))}")
        moving = tuple(camera for camera in inputs.cameras if moves(episode.arrays, camera))
        found = {f"cameras/{camera}/{leaf}" for camera in inputs.cameras for leaf in CAMERA_FACTS} & set(episode.arrays)
        found -= set(_fixed_poses(moving))
        constants = {path: np.asarray(episode.arrays[path], np.float64).tolist() for path in sorted(found)}
        centre: tuple[float, float] | None = None
        if "workspace" in episode.arrays:
            x, y = np.asarray(episode.arrays["workspace"], np.float64)[:2].mean(axis=1).tolist()
            centre = x, y
        return cls(
            episode.meta.task, _ordered(inputs), action, tuple(_declared(episode, path) for path in sorted(set(paths))),
            constants, centre, tuple(sorted(invariant)), moving,
        )  # fmt: skip

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> "RecordedSpec":
        """Restore a spec from `plain`.

        Args:
            found: Values of the attributes by name, as JSON gives them.

        Raises:
            ValueError: If the values are impossible for a spec.
        """
        spec = msgspec.convert(found, cls)
        for field in spec.fields:
            if fault := field_fault(field):
                raise ValueError(f"{field.path} {fault}")
            if not field.grows or any(isinstance(size, str) for size in field.shape[1:]) or not _numeric(field.dtype):
                raise ValueError(f"{field.path} has the shape {field.shape_words} and dtype {field.dtype}")
        if max([spec.inputs.frames, *(one.length for one in spec.inputs.windows.values())]) > LONGEST:
            raise ValueError(f"a window of more than {LONGEST} rows")
        if spec.moving != tuple(camera for camera in spec.inputs.cameras if camera in spec.moving):
            raise ValueError(f"moving is {spec.moving}, the cameras are {spec.inputs.cameras}")
        if contradiction := [path for path in _fixed_poses(spec.moving) if path in spec.constants]:
            raise ValueError(f"{contradiction[0]} is of a camera that moves")
        for path, numbers in [*spec.constants.items(), ("centre", spec.centre or ())]:
            value = np.asarray(numbers, np.float64)
            if not (np.abs(value) <= LARGEST).all():
                raise ValueError(f"{path} has impossible numbers")
            if path.endswith("/image_axes") and not np.allclose(value @ value.T, np.eye(2), atol=1e-6):
                raise ValueError(f"{path} is no orthogonal matrix")
            if path.endswith("/depth_scale") and (value.shape != () or value <= 0):
                raise ValueError(f"{path} is {value}")
        return replace(spec, inputs=_ordered(spec.inputs))

    def plain(self) -> dict[str, Any]:
        """Return the spec as plain values for files."""
        return asdict(self)

    def layout(self, config: ReplayConfig) -> Layout:
        """Return what is kept of an episode and given in a batch (`svfl_data.replay.specs.recorded_layout`).

        Args:
            config: Settings of the replay buffer.

        Raises:
            UsageError: If transitions are to be rotated, but something does not say how it transforms.
        """
        return layout_of(self, config)

    def require_equal(self, other: Spec, where: str, there: str) -> None:
        """Refuse another spec if it differs from this spec; see `svfl_data.replay.specs.spec.Spec`."""
        if not isinstance(other, RecordedSpec):
            raise difference("input", "any input by its path", "the paper's (image, wrench, proprio)", where, there)
        if other == self:
            return
        for name in ("task", "inputs", "action", "centre", "invariant"):
            if getattr(self, name) != getattr(other, name):
                raise difference(name, getattr(self, name), getattr(other, name), where, there)
        if self.moving != other.moving:
            raise difference("list of cameras that move", self.moving, other.moving, where, there)
        for path in sorted({*self.constants, *other.constants}):
            if self.constants.get(path) != other.constants.get(path):
                raise difference(path, self.constants.get(path), other.constants.get(path), where, there)
        theirs = {field.path: field for field in other.fields}
        for field in self.fields:
            if field.path not in theirs:
                raise difference("input", field.path, "without it", where, there)
            for name in COMPARED:
                mine, its = getattr(field, name), getattr(theirs[field.path], name)
                if mine != its:
                    raise difference(f"{name} of {field.path}", mine, its, where, there)
        extra = sorted(theirs.keys() - {field.path for field in self.fields})
        raise difference("input", "without it", ", ".join(extra), where, there)

    def kept(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return the values, shape (M, ...), unchanged."""
        return values

    def observed(self, observation: Observation, layout: Layout) -> dict[str, np.ndarray]:
        """Return the rows of an observation: those that `svfl_data.sampling.cut.cut_steps` gives for one step.

        Args:
            observation: By dataset path the images (K, H, W, ...) and windows (T, ...), tared, and the vectors; also
                ``GROUP/padding`` and ``GROUP/age``, if they are not there nothing is padded and the age is 0. Cameras
                that move have ``cameras/NAME/image_axes`` (K, 2, 2).
            layout: Layout of the replay buffer.

        Raises:
            FieldError: If an array of the observation is missing or has a wrong shape or value.
        """
        rows: dict[str, np.ndarray] = {}
        for stream in layout.streams:
            rows |= {one.name: _value(observation, one, (stream.length,)) for one in stream.arrays}
            mask = np.asarray(observation.get(padding_key(stream.group), np.zeros(stream.length, bool)))
            padded = int(mask.sum()) if mask.dtype == bool else 0
            if mask.shape != (stream.length,) or mask.dtype != bool or not mask[:padded].all():
                raise FieldError(
                    f"{padding_key(stream.group)} is {mask.dtype} {mask.shape}; it must be {stream.length} booleans, "
                    "those that are true first"
                )
            age = np.asarray(observation.get(age_key(stream.group), 0.0))
            if age.shape != () or age.dtype.kind not in "fiu" or not age >= 0:
                raise FieldError(f"{age_key(stream.group)} must be one number from 0 upwards")
            rows |= {stream.padded: np.array(padded, np.int64), stream.age: age.astype(np.float32)}
        for name in (axes_key(f"cameras/{camera}") for camera in self.moving):
            if not np.allclose(rows[name] @ rows[name].swapaxes(-2, -1), np.eye(2), atol=1e-5):
                raise FieldError(f"{name} holds a matrix from base (x, y) to image (right, up) that is not orthogonal")
        return rows | {one.name: _value(observation, one) for one in layout.vectors}

    def acted(self, action: np.ndarray) -> np.ndarray:
        """Return an action (C,) as recorded.

        Raises:
            FieldError: If it has a wrong shape or value, or is beyond the bounds.
        """
        field = self.field(self.action)
        acted = _cast(field.path, finite(field.path, action, _row(field)), field.dtype)
        bounds = ActionBounds.of(field)
        if bounds and (fault := bounds.fault(acted[None])):
            raise FieldError(f"{field.path}: {fault[1]}")
        return acted


def _declared(episode: Episode, path: str) -> Field:
    """Return the declaration of an array with the sizes that were recorded, reduced to what must be equal."""
    if path not in episode.arrays:
        raise FieldError(f"{episode.name}: has no {path}; it has {', '.join(episode.arrays)}")
    field, array = episode.declarations.at(path), episode.arrays[path]
    if field is None or not field.grows or not _numeric(str(array.dtype)):
        raise FieldError(f"{episode.name}: {path} is not a declared array of numbers with a row for each reading")
    bounds = tuple((float(low), float(high)) for low, high in field.bounds)
    return replace(
        field, shape=("rows", *array.shape[1:]), dtype=str(array.dtype), doc="", name="", assumed=(), bounds=bounds,
        possible=(-LARGEST, LARGEST),
    )  # fmt: skip


def _fixed_poses(moving: Collection[str]) -> list[str]:
    """Return the paths of the constants that only a fixed camera has."""
    return [f"cameras/{camera}/{leaf}" for camera in moving for leaf in ("T_base_camera", "image_axes")]


def _numeric(dtype: str) -> bool:
    try:
        return np.dtype(dtype).kind in "biuf" and np.dtype(dtype).isnative
    except (TypeError, SyntaxError):
        return False


def _row(field: Field) -> tuple[int, ...]:
    return tuple(size for size in field.shape[1:] if isinstance(size, int))


def _ordered(inputs: InputSpec) -> InputSpec:
    """Return the inputs as they are after reading them from a file: windows in the order of their paths."""
    windows = {
        path: replace(one, rate_hz=None if one.rate_hz is None else float(one.rate_hz))
        for path, one in sorted(inputs.windows.items())
    }
    return replace(inputs, cameras=tuple(inputs.cameras), windows=windows, vectors=tuple(inputs.vectors))


def _value(observation: Observation, array: Array, rows: tuple[int, ...] = ()) -> np.ndarray:
    if array.name not in observation:
        raise FieldError(f"observation: {array.name} is missing; it has {', '.join(observation) or 'nothing'}")
    return _cast(array.name, finite(array.name, observation[array.name], (*rows, *array.row)), array.dtype)


def _cast(name: str, values: np.ndarray, dtype: str) -> np.ndarray:
    with np.errstate(all="ignore"):
        found = values.astype(dtype)
    if not np.isfinite(found).all() or (found.dtype.kind != "f" and not np.array_equal(found, values)):
        raise FieldError(f"{name} ({values.dtype}) holds numbers that {dtype} cannot hold")
    return found
