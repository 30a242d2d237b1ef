"""The cut of observations out of one episode: images, windows and vectors at its steps.

The arrays may be those of a recorded episode, or what a robot has measured so far. `svfl_data.sampling.samples.Samples`
cuts batches of many episodes with the same functions (`svfl_data.sampling.ragged`), so a program that acts, a viewer
and a training see the same numbers.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.sampling.batch import Batch, age_key, axes_key, padding_key
from svfl_data.sampling.ragged import rows_of
from svfl_data.schema.clocks import Clock
from svfl_data.schema.declarations import STANDARD, Declarations
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.schema.validity import Readable
from svfl_data.signals.camera_poses import camera_poses, frame_axes, moves


def cut_steps(episode: Episode, inputs: InputSpec, steps: Sequence[int] | None = None) -> Batch:
    """Cut the observations at some steps out of an episode.

    Args:
        episode: The episode.
        inputs: What is taken.
        steps: Rows of the observations, S of them; -1 is the final one. All by default.

    Returns:
        Values by the keys of `svfl_data.sampling.samples.Samples`, each of shape (S, ...), without what an episode has
        once, such as ``depth_scale``.

    Raises:
        FieldError: If the episode was recorded without one of the arrays.
        DatasetError: If a stream has another rate than its window.

    Example:
        >>> inputs = InputSpec(windows={"streams/wrench/wrench": Window(64)}, vectors=("observations/proprio",))
        >>> seen = cut_steps(dataset[0], inputs, steps=[-1])
        >>> seen["streams/wrench/wrench"].shape, seen["observations/proprio"].shape
        ((1, 64, 6), (1, 5))
    """
    rows = np.arange(len(episode.t_ns))[slice(None) if steps is None else list(steps)]
    return cut(
        episode.arrays, inputs, episode.t_ns[rows], rows, lambda group: Clock.of(episode.meta, group),
        episode.declarations, episode.name,
    )  # fmt: skip


def cut(
    arrays: Mapping[str, Readable],
    inputs: InputSpec,
    now_ns: np.ndarray,
    rows: np.ndarray,
    clock_of: Callable[[str], Clock] = lambda group: Clock(),
    declarations: Declarations = STANDARD,
    name: str = "episode",
) -> Batch:
    """Cut observations out of arrays.

    Args:
        arrays: Arrays by dataset path: those of an episode, or what a robot has measured so far.
        inputs: What is taken.
        now_ns: Times of the observations, shape (S,), [ns]. Nothing later is taken.
        rows: Rows of the observations in the arrays below ``observations/``, shape (S,).
        clock_of: Function that returns what was declared about the clock of a group; by default nothing.
        declarations: Declarations of the arrays.
        name: Name of the source in messages.

    Returns:
        Values by the keys of `svfl_data.sampling.samples.Samples`, each of shape (S, ...), without what an episode has
        once, such as ``depth_scale``.

    Raises:
        FieldError: If an array is missing.
        DatasetError: If a stream has another rate than its window.
    """
    out = {path: rows_from_1(_array(arrays, path, name), rows + 1) for path in inputs.vectors}
    groups = {f"cameras/{camera}": Window(inputs.frames) for camera in inputs.cameras} | inputs.groups
    for group, window in groups.items():
        t_ns = np.asarray(_array(arrays, f"{group}/t_ns", name)[0 : 2**62])
        seen = rows_of([t_ns], [now_ns], [clock_of(group)], window, group, [name])
        taken, out[padding_key(group)] = seen.last(np.arange(len(now_ns)), window.length)
        out[age_key(group)] = seen.age
        if group.startswith("cameras/"):
            paths = declarations.image_paths(group.removeprefix("cameras/"), arrays)
            out |= {path: rows_from_1(arrays[path], taken) for path in paths}
            if moves(arrays, camera := group.removeprefix("cameras/")):
                out[axes_key(group)] = axes_from_1(arrays, camera, taken)
            continue
        for path in (path for path in inputs.windows if path.rpartition("/")[0] == group):
            if (found := _array(arrays, path, name).shape[:1]) != t_ns.shape:
                rows_found = found[0] if found else "no"
                raise FieldError(f"{name}: {path} has {rows_found} rows, and {group}/t_ns has {len(t_ns)} times")
            out[path] = readings(arrays, path, taken, name)
    return out


def readings(arrays: Mapping[str, Readable], path: str, rows: np.ndarray, name: str = "episode") -> np.ndarray:
    """Return rows of an array of a stream, (*rows.shape, ...), minus the ``tare`` of its group if it has one.

    Args:
        arrays: Arrays by dataset path.
        path: Path of the array.
        rows: Numbers of rows from 1, any shape; 0 stands for a row of zeros, before the first reading.
        name: Name of the source in messages.

    Raises:
        FieldError: If the array is missing.
    """
    values = rows_from_1(_array(arrays, path, name), rows)
    tare = np.asarray(arrays.get(f"{path.rpartition('/')[0]}/tare", 0.0))
    if tare.shape == values.shape[rows.ndim :]:
        values[rows > 0] = (values[rows > 0] - tare).astype(values.dtype)
    return values


def axes_from_1(arrays: Mapping[str, Readable], camera: str, rows: np.ndarray) -> np.ndarray:
    """Return the matrices from base (x, y) to image (right, up) at frames of a camera, (*rows.shape, 2, 2), float32.

    Args:
        arrays: Arrays by dataset path.
        camera: Name of a camera that moves (`svfl_data.signals.camera_poses.moves`).
        rows: Numbers of frames from 1, any shape; 0 stands for no frame, before the first one, and has the identity.
    """
    t_ns = np.asarray(arrays[f"cameras/{camera}/t_ns"][0 : 2**62])
    axes = frame_axes(camera_poses(arrays, camera, t_ns))
    return np.asarray(np.concatenate([np.eye(2)[None], axes]).astype(np.float32)[rows])


def _array(arrays: Mapping[str, Readable], path: str, name: str) -> Readable:
    if path not in arrays:
        raise FieldError(f"{name}: has no {path}; it has {', '.join(arrays)}")
    return arrays[path]


def rows_from_1(array: Readable, rows: np.ndarray) -> np.ndarray:
    """Return rows that are numbered from 1, (*rows.shape, ...); row 0 is one of zeros, before the first reading.

    Args:
        array: Array, shape (M, ...).
        rows: Numbers of rows, any shape.
    """
    out = np.zeros((*rows.shape, *array.shape[1:]), array.dtype)
    there = rows > 0
    if there.any():
        first, last = int(rows[there].min()), int(rows.max())
        out[there] = np.asarray(array[first - 1 : last])[rows[there] - first]
    return out
