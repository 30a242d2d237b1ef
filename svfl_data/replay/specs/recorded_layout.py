"""The layout of a replay buffer with any inputs and any action, derived from their declarations."""

import numpy as np

from svfl_data.errors import UsageError
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.specs.layout import Array, Axes, Layout, Picture, Plane, Stream
from svfl_data.replay.specs.recorded_inputs import RecordedInputs
from svfl_data.sampling.batch import axes_key
from svfl_data.schema.field import Field
from svfl_data.symmetry import Part

LONGEST = 100_000
"""Largest number of rows of a window in a saved file."""
SMOOTH = ("color", "grey")
"""Images that are interpolated where pixels do not move onto pixels; of depth and labels the nearest pixel is taken."""
AXES_PARTS = (Part("vector", (0, 1)),)
"""Parts of image axes, which are rotated in base axes only: both rows, image right and up, are vectors there."""


def layout_of(spec: RecordedInputs, config: ReplayConfig) -> Layout:
    """Return what is kept of an episode and given in a batch.

    Args:
        spec: Specification of the replay buffer.
        config: Settings of the replay buffer.

    Raises:
        UsageError: If transitions are to be rotated, but something does not say how it transforms; or `config` gives
            frames or a window, which are those of the paper's inputs.
    """
    if config.frames != 1 or config.window != ReplayConfig.window:
        raise UsageError("frames and window of the configuration are the paper's; say them in the inputs (InputSpec)")
    cameras = {name: _axes(spec, name, config.rotate) for name in spec.inputs.cameras}
    turning = [axes for axes in cameras.values() if axes is not None]
    group = turning[0] if turning else np.eye(2)
    streams, pictures = [], []
    for name, axes in cameras.items():
        fields = [field for field in spec.fields if field.group == f"cameras/{name}" and field.image]
        arrays = [_array(field, spec, rotate=False) for field in fields]
        if name in spec.moving:
            parts = AXES_PARTS if config.rotate else ()
            arrays.append(Array(axes_key(f"cameras/{name}"), (2, 2), "float32", parts))
        stream = _stream(f"cameras/{name}", arrays, spec.inputs.frames)
        streams.append(stream)
        pictures += [_picture(field, stream, None if axes is None else _rows(group @ axes.T)) for field in fields]
    for name, window in spec.inputs.groups.items():
        fields = [spec.field(path) for path in spec.inputs.windows if path.rpartition("/")[0] == name]
        streams.append(_stream(name, [_array(field, spec, config.rotate) for field in fields], window.length))
    vectors = tuple(_array(spec.field(path), spec, config.rotate) for path in spec.inputs.vectors)
    scales = {path: value for path, value in spec.constants.items() if path.endswith("/depth_scale")}
    action = _array(spec.field(spec.action), spec, config.rotate)
    return Layout(tuple(streams), vectors, action, tuple(pictures), _rows(group), scales)


def _axes(spec: RecordedInputs, camera: str, rotate: bool) -> np.ndarray | None:
    """Return the matrix from base (x, y) to the image of a camera, (2, 2); None if its images stay.

    A camera that moves rotates with the scene, so its images stay, and the matrix of each frame is rotated.
    """
    name = f"cameras/{camera}"
    if name in spec.invariant or camera in spec.moving:
        return None
    if f"{name}/T_base_camera" in spec.constants and f"{name}/image_axes" in spec.constants:
        return np.array(spec.constants[f"{name}/image_axes"])
    if rotate:
        raise UsageError(
            f"rotate: {name} has no fixed pose in base with image axes, so it is unknown how its images rotate; "
            f"invariant=[{name!r}] leaves them as they are"
        )
    return None


def _stream(group: str, arrays: list[Array], length: int) -> Stream:
    return Stream(tuple(arrays), length, f"rows/{group}", f"padded/{group}", f"age/{group}", group)


def _array(field: Field, spec: RecordedInputs, rotate: bool) -> Array:
    row = tuple(size for size in field.shape[1:] if isinstance(size, int))
    plain = Array(field.path, row, field.dtype)
    if not rotate or field.path in spec.invariant:
        return plain
    if not field.parts or np.dtype(field.dtype).kind != "f":
        way = "do without" if field.path == spec.action else f"invariant=[{field.path!r}] leaves it as it is"
        raise UsageError(f"rotate: {field.path} ({field.dtype}) does not declare how it transforms (parts); {way}")
    if field.about != "base origin":
        return Array(field.path, row, field.dtype, field.parts)
    if spec.centre is None:
        raise UsageError(f"rotate: {field.path} is measured from the base origin; its rotation needs a workspace")
    offset = np.zeros(row[-1])
    for part in field.parts:
        if part.kind == "vector":
            offset[list(part.index)] = spec.centre
    return Array(field.path, row, field.dtype, field.parts, tuple(offset.tolist()))


def _picture(field: Field, stream: Stream, axes: Axes | None) -> Picture:
    height, width, *channels = (size for size in field.shape[1:] if isinstance(size, int))
    plane = Plane(field.path, smooth=field.path.rpartition("/")[2] in SMOOTH, last=bool(channels))
    return Picture(field.path, stream, (plane,), (-1, -1, *channels), field.dtype, (height, width), axes)


def _rows(matrix: np.ndarray) -> Axes:
    (a, b), (c, d) = matrix.tolist()
    return (a, b), (c, d)
