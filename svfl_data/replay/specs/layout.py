"""What a replay buffer keeps of an episode and gives in a batch, for any inputs and any action.

A specification (`svfl_data.replay.specs.replay_spec`, `svfl_data.replay.specs.recorded_spec`) says it once as a
`Layout`. Episodes, batches, rotations and saved files follow the layout, and do not depend on particular cameras or
sensors.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import EllipsisType

import numpy as np

from svfl_data.errors import UsageError
from svfl_data.symmetry import Part

REWARD = "reward"
Where = int | slice | EllipsisType
Axes = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Array:
    """An array of which rows are kept.

    Attributes:
        name: Name in the stored episode, and key in batches unless the array is part of a picture.
        row: Shape of a row.
        dtype: NumPy dtype as a text.
        parts: Parts of the components of the last axis that are rotated and reflected; empty if the array stays.
        offset: Numbers that are subtracted from the components before they are rotated and added afterwards, because
            positions rotate about the centre of the workspace. Empty if there is nothing to subtract.
    """

    name: str
    row: tuple[int, ...]
    dtype: str
    parts: tuple[Part, ...] = ()
    offset: tuple[float, ...] = ()


@dataclass(frozen=True)
class Stream:
    """Arrays with one clock, of which the last rows at or before each observation are given.

    Attributes:
        arrays: The arrays.
        length: Number of rows that are given at an observation.
        end: Name of the array (N+1,) that has the number of rows up to each observation. Empty if there is one row for
            each observation.
        padded: Name of the array (N+1,) that has the number of leading rows that are padding; empty if it is not kept.
        age: Name of the array (N+1,) that has the age of the newest row, [s]; empty if it is not kept.
        group: Group that the padding and the age belong to (`svfl_data.sampling.batch`).
    """

    arrays: tuple[Array, ...]
    length: int
    end: str = ""
    padded: str = ""
    age: str = ""
    group: str = ""


@dataclass(frozen=True)
class Plane:
    """An array of images as a part of a picture.

    Attributes:
        name: Name of the array of images, whose rows have the shape (H, W), (C, H, W) or, with `last`, (H, W, C).
        where: Channels of the picture that the images fill; the whole picture by default.
        smooth: Whether pixels are interpolated where they do not move onto pixels; otherwise the nearest one is taken.
        last: Whether the channels are the last axis.
        divisor: Number by which the pixels are divided, if not None.
        factor: Number by which the pixels are multiplied, if not None.
    """

    name: str
    where: int | tuple[int, int] | EllipsisType = ...
    smooth: bool = True
    last: bool = False
    divisor: float | None = None
    factor: float | None = None

    @property
    def plain(self) -> tuple[str, Where, bool, bool, np.ufunc | None, np.float32]:
        """Name, index of the channels, `smooth`, `last`, and the operation that scales pixels, with its number."""
        where: Where = slice(*self.where) if isinstance(self.where, tuple) else self.where
        number = self.factor if self.divisor is None else self.divisor
        operation = np.multiply if self.divisor is None else np.divide
        if number is None:
            return self.name, where, self.smooth, self.last, None, np.float32(1)
        return self.name, where, self.smooth, self.last, operation, np.float32(number)


@dataclass(frozen=True)
class Picture:
    """Images of a batch under one key.

    Attributes:
        key: Key in batches.
        stream: Stream of the images.
        planes: Arrays of images that make up the picture.
        shape: Shape of a picture, with -1 in the places of height and width.
        dtype: NumPy dtype of the picture as a text.
        size: Height and width of the recorded images, [px].
        axes: Rows of the matrix from image-aligned (right, up) to the axes of the group; None if the picture stays.
        flat: Whether the picture at an observation is a single one, without an axis of the stack.
    """

    key: str
    stream: Stream
    planes: tuple[Plane, ...]
    shape: tuple[int, ...]
    dtype: str
    size: tuple[int, int]
    axes: Axes | None = ((1.0, 0.0), (0.0, 1.0))
    flat: bool = False

    def cut_size(self, crop: int | None) -> tuple[int, int]:
        """Return height and width of the pictures of a batch: those of the crop, or those of the recorded images."""
        return (crop, crop) if crop else self.size


@dataclass(frozen=True)
class Layout:
    """What is kept of each episode, and what is given of each observation and action.

    Attributes:
        streams: Images and windows. The arrays that are planes of a picture are images; all others are numbers, which a
            batch has by their names.
        vectors: Arrays with a row for each observation.
        action: Array with a row for each action.
        pictures: Images of a batch.
        axes: Rows of the matrix from the axes of vectors (x, y) to the axes of the group.
        constants: Numbers that are given with each transition, by key.
    """

    streams: tuple[Stream, ...]
    vectors: tuple[Array, ...]
    action: Array
    pictures: tuple[Picture, ...]
    axes: Axes | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    def names(self) -> list[str]:
        """Return the names of all arrays of a stored episode, in the order of its file."""
        return [name for name, *_ in self._expected(0)]

    def faults(self, arrays: Mapping[str, np.ndarray]) -> Iterator[str]:
        """Yield what does not fit the layout in the arrays of an episode, in words.

        Args:
            arrays: Arrays by name; all names are there.
        """
        steps = len(arrays[REWARD])
        if not steps:
            yield "0 steps"
        for name, rows, row, dtype in self._expected(steps):
            array = arrays[name]
            expected = (len(array) if array.ndim and rows is None else rows, *row)
            if (array.shape, array.dtype) != (expected, np.dtype(dtype)):
                yield f"{name} is {array.dtype} {array.shape}, expected {dtype} {expected}"
                return
        for stream in self.streams:
            lengths = {len(arrays[one.name]) for one in stream.arrays}
            if stream.end and (len(lengths) > 1 or _outside(arrays[stream.end], min(lengths))):
                yield f"{stream.end} reaches beyond the {min(lengths)} rows that there are"
            if stream.padded and _outside(arrays[stream.padded], stream.length):
                yield f"{stream.padded} is not from 0 to {stream.length}"
            if stream.age and not (arrays[stream.age] >= 0).all():
                yield f"{stream.age} is below 0"

    def require_crop(self, crop: int | None, rotate: bool) -> None:
        """Refuse crops that do not fit into the images, and images of unequal sides that are to be rotated.

        Args:
            crop: Height and width of the crops, [px]; None for whole images.
            rotate: Whether images are rotated.

        Raises:
            UsageError: If the images cannot be cut in this way.
        """
        for picture in self.pictures:
            (height, width), name = picture.size, picture.key
            if crop and crop > min(picture.size):
                raise UsageError(
                    f"crop is {crop} px; the images of {name} have {height} x {width} px; crop=None takes them whole"
                )
            if rotate and picture.axes and not crop and height != width:
                raise UsageError(
                    f"rotate needs square images, {name} has {height} x {width} px; crop them (crop=), or do without"
                )

    def _expected(self, steps: int) -> Iterator[tuple[str, int | None, tuple[int, ...], str]]:
        """Yield name, number of rows (None for any), shape of a row and dtype of each array."""
        for stream in self.streams:
            for one in stream.arrays:
                yield one.name, None if stream.end else steps + 1, one.row, one.dtype
            for name, dtype in ((stream.end, "int64"), (stream.padded, "int64"), (stream.age, "float32")):
                if name:
                    yield name, steps + 1, (), dtype
        for one in self.vectors:
            yield one.name, steps + 1, one.row, one.dtype
        yield self.action.name, steps, self.action.row, self.action.dtype
        yield REWARD, steps, (), "float32"


def _outside(values: np.ndarray, most: int) -> bool:
    return bool(((values < 0) | (values > most)).any())
