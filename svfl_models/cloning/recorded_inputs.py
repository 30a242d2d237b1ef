"""Inputs of a policy: named on the command line, looked up in what was recorded, and kept in a checkpoint."""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import msgspec
import numpy as np

from svfl_data.errors import TrainingError, UsageError
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.field import Field
from svfl_data.schema.input_spec import Window
from svfl_data.signals.camera_poses import moves
from svfl_data.signals.pictures import BRIGHTEST
from svfl_data.storage.reader import EpisodeReader
from svfl_data.symmetry import Part, act
from svfl_models.networks.action_space import parts_of
from svfl_models.networks.input_types import (
    ImageInput,
    NetworkInput,
    PlainParts,
    SequenceInput,
    VectorInput,
    parts_of_plain,
    plain_parts,
)

WORDS = re.compile(r"(?P<path>[^=@:]+)(=(?P<length>[1-9]\d{0,4}))?(@(?P<rate>\d+(\.\d+)?))?(?P<invariant>:invariant)?")
EXAMPLE = "cameras/front, streams/wrench/wrench=64@500, observations/proprio"


@dataclass(frozen=True)
class RecordedInput:
    """One input of a policy: what is taken from a recording, and how it enters the network.

    Attributes:
        path: Group of a camera, such as ``cameras/front``, or path of an array of a stream or below ``observations/``.
            It is also the name of the network's input.
        kind: ``image``, ``sequence`` or ``vector``.
        parts: Parts of the components, as plain values (`networks.input_types.PlainParts`); empty for images.
        length: Number of readings of a sequence.
        rate_hz: Rate of a sequence, [Hz]; None for every rate.
        images: Last parts of the paths of an image's arrays: ``color``, ``grey``, ``grey16`` and ``depth``, as far as
            recorded.
        size: Height and width of the images as recorded, [px].
        depth_scale: Metres per unit of depth.
        moves: ``pixels`` if images rotate with the scene, ``turned`` if they do so after they were rotated from the
            axes of their camera, which moves, into the image-aligned axes of the policy, else ``invariant``.
        offset: Numbers that are subtracted from the components in base axes: the workspace centre from positions.
    """

    path: str
    kind: Literal["image", "sequence", "vector"]
    parts: PlainParts = field(default_factory=list)
    length: int = 0
    rate_hz: float | None = None
    images: tuple[str, ...] = ()
    size: tuple[int, int] = (0, 0)
    depth_scale: float = 1.0
    moves: Literal["pixels", "turned", "invariant"] = "pixels"
    offset: tuple[float, ...] = field(default=())

    @property
    def axes(self) -> str | None:
        """Path of the matrix that a rotated image needs: from base (x, y) to image (right, up), shape (2, 2)."""
        return f"{self.path}/image_axes" if self.moves == "turned" else None

    @property
    def channels(self) -> int:
        """Number of channels of an image: three of colour, one of grey, one of depth."""
        return sum(3 if name == "color" else 1 for name in self.images)

    @property
    def typed(self) -> tuple[Part, ...]:
        """Parts of the components."""
        return parts_of_plain(self.parts)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values that a policy takes, without the batch dimension."""
        if self.kind == "image":
            return (self.channels, *self.size)
        count = sum(len(part.index) for part in self.typed)
        return (self.length, count) if self.kind == "sequence" else (count,)

    def network(self) -> NetworkInput:
        """Return the input of the network."""
        if self.kind == "image":
            return ImageInput(self.path, self.channels, "invariant" if self.moves == "invariant" else "pixels")
        if self.kind == "sequence":
            return SequenceInput(self.path, self.typed, self.length)
        return VectorInput(self.path, self.typed)

    def maps(self, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return matrix, offset and turn with which ``(x - offset) @ matrix + turn`` is in image-aligned axes.

        Args:
            axes: Matrix from base (x, y) to image (right, up), shape (2, 2).
        """
        count = self.shape[-1]
        turn = act(axes, np.zeros(count), self.typed)  # what is added to angles
        return act(axes, np.eye(count), self.typed) - turn, np.array(self.offset or np.zeros(count)), turn

    def plain(self) -> dict[str, Any]:
        """Return the input as plain values for files."""
        return asdict(self)


def of_plain(values: Sequence[dict[str, Any]]) -> list[RecordedInput]:
    """Restore inputs from the plain values of `RecordedInput.plain`.

    Raises:
        TrainingError: If the values are not those of inputs.
    """
    try:
        return [msgspec.convert(one, RecordedInput) for one in values]
    except msgspec.ValidationError as error:
        raise TrainingError(f"the inputs of a policy cannot be read ({error})") from error


def recorded_input(words: str, reader: EpisodeReader, symmetric: bool) -> RecordedInput:
    """Look up an input of a policy in an episode.

    Args:
        words: Path, then for a stream the number of readings and the rate, such as ``streams/wrench/wrench=64@500``.
            With ``:invariant`` at the end, the input does not rotate with the scene: a sensor on the gripper, or a
            camera on it whose images are to be taken as they are.
        reader: Reader of an episode.
        symmetric: Whether the network is symmetric.

    Raises:
        UsageError: If the words are not those of an input, or the episode does not have it.
        TrainingError: If a symmetric network cannot take the input, because its transformation is not declared.
    """
    match = WORDS.fullmatch(words)
    if match is None:
        raise UsageError(f"{words!r} is not an input; inputs are written like {EXAMPLE}")
    path, invariant = match["path"], bool(match["invariant"])
    if path.startswith("cameras/"):
        return _image(path, reader, invariant)
    declared = reader.declarations.at(path) if path in reader else None
    if declared is None or not _is_input(declared):
        raise UsageError(f"{reader.extent}: no input {path!r}; there are {', '.join(_possible(reader)) or 'none'}")
    parts = _parts(declared, reader[path].shape[1:], symmetric, invariant)
    plain = plain_parts(parts)
    offset = _offset(declared, parts, reader)
    if path.startswith("observations/"):
        if match["length"] or match["rate"]:
            raise UsageError(f"{words!r}: an observation has no window")
        return RecordedInput(path, "vector", plain, offset=offset)
    rate = float(match["rate"]) if match["rate"] else None
    return RecordedInput(path, "sequence", plain, int(match["length"] or 1), rate, offset=offset)


def windows(inputs: Sequence[RecordedInput]) -> dict[str, Window]:
    """Return the windows of the inputs that are sequences, for `svfl_data.sampling.samples.Samples`."""
    return {one.path: Window(one.length, one.rate_hz) for one in inputs if one.kind == "sequence"}


def _image(path: str, reader: EpisodeReader, invariant: bool) -> RecordedInput:
    name = path.removeprefix("cameras/")
    if name not in reader.cameras:
        raise UsageError(f"{reader.extent}: no camera {name!r}; there are: {', '.join(reader.cameras) or 'none'}")
    images = tuple(leaf for leaf in (*BRIGHTEST, "depth") if f"{path}/{leaf}" in reader)
    if not images:
        raise UsageError(f"{reader.extent}: {path} has no images that a network takes: {', '.join(BRIGHTEST)} or depth")
    still = f"{path}/T_base_camera" in reader and f"{path}/image_axes" in reader
    moving: Literal["turned", "invariant"] = "turned" if moves(reader.paths, name) else "invariant"
    scale = float(reader[f"{path}/depth_scale"][()]) if "depth" in images else 1.0
    return RecordedInput(
        path, "image", images=images, size=reader.image_size(name), depth_scale=scale,
        moves="invariant" if invariant else "pixels" if still else moving,
    )  # fmt: skip


def _parts(declared: Field, row: tuple[int, ...], symmetric: bool, invariant: bool) -> tuple[Part, ...]:
    count = int(np.prod(row))
    if invariant or (not declared.parts and not symmetric) or len(row) > 1:
        return (Part("invariant", tuple(range(count))),)
    return parts_of(declared, symmetric)


def _offset(declared: Field, parts: Sequence[Part], reader: EpisodeReader) -> tuple[float, ...]:
    """Return the workspace centre in the places of a position's x and y, about which the scene rotates."""
    if declared.about != "base origin" or "workspace" not in reader:
        return ()
    offset = np.zeros(sum(len(part.index) for part in parts))
    for part in parts:
        if part.kind == "vector":
            offset[list(part.index)] = np.round(reader["workspace"][:2].mean(axis=1), 9)
    return tuple(offset.tolist())


def _possible(reader: EpisodeReader) -> list[str]:
    declared: Declarations = reader.declarations
    arrays = [path for path in reader.paths if (one := declared.at(path)) and _is_input(one)]
    return [*(f"cameras/{camera}" for camera in reader.cameras), *arrays]


def _is_input(declared: Field) -> bool:
    """Return whether an array has a row of real numbers per reading or observation; times and texts are no inputs."""
    place = declared.path.startswith(("streams/", "observations/")) and not declared.path.endswith("/t_ns")
    return place and declared.grows and declared.numpy_dtype.kind in "biuf"
