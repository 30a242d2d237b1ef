"""The declaration of one array: what its numbers mean, how they transform, and how it is stored in a file."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import msgspec
import numpy as np

from svfl_data.errors import FieldError
from svfl_data.symmetry import Kind, Part, parts_named
from svfl_data.system.printable import printable

Size = int | str
LARGEST = 1e6
"""Largest magnitude of every declared number, in its unit, except where its field declares other bounds. No arm, sensor
or camera comes near it (the largest six-axis sensors measure 4e4 N), and the sum of a thousand million squares of it
is still finite in float32."""
LARGE_ROW = 64
"""Number of elements of a row from which on the array may be large, so that tools read it row by row, like images."""
ASSUMABLE = ("unit", "axes", "about", "components", "parts", "bounds", "delta")
"""Attributes of a declaration that may be marked as assumed."""
TEXT_LIMIT = 2**16
"""Largest length of each text of a stored declaration."""
DIMENSIONS, LARGEST_SIZE, NAME_LENGTH = 16, 2**48, 100
"""Largest number of dimensions of an array, largest size of each, and largest number of characters of the name of a
component or of a symbol."""
FAULT_LENGTH = 1000
"""Largest number of characters of the words that say what is wrong with a declaration."""
FARTHEST = 2.0**62
"""Largest magnitude of every declared bound, in the unit of the array, so that squares stay finite in float32."""
MEANING = ("unit", "axes", "about", "doc", "declaration")
"""Attributes of an HDF5 dataset that make up its declaration. The last one is JSON (`Stored`)."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """Declaration of one array of an episode.

    A file keeps the declaration of each of its arrays. The standard fields are `svfl_data.schema.fields.FIELDS`; an
    array of your own is declared with the same class, see `svfl_data.schema.declarations.Declarations`.

    Attributes:
        path: Path of the dataset in the HDF5 file.
        dtype: NumPy dtype of the array on disk and in memory.
        shape: Sizes of the array. The first size is a symbol if the array has a row per reading, and a number if the
            episode has the array once. Equal symbols must have equal sizes in all fields of an episode, a camera or a
            stream of the user's own.
        unit: Unit of the stored numbers; ``-`` if there is none.
        doc: Description of the array.
        axes: Axes in which vectors are expressed; ``-`` if there are none.
        about: Point about which torques are taken, or from which positions are measured; ``-`` if there is none.
        components: Names of the components along the last axis; empty if they have no names.
        parts: Parts of the last axis with the way in which they transform under planar rotations and reflections; empty
            if the array does not transform.
        bounds: Smallest and largest number that may be commanded, for each component; empty for arrays that are not
            commanded.
        delta: Whether each component is a change relative to the present state, rather than an absolute value; empty
            for arrays that are not commanded.
        image: Whether rows and columns of the array are pixels, which move under rotations.
        possible: Smallest and largest number that is possible at all. What a robot can do is far within these bounds.
        assumed: Names of the attributes (`ASSUMABLE`) that are assumptions, because the source of the data did not say.
        name: Name of a standard field as an attribute of `svfl_data.schema.episode.Episode` or of its `Camera`; empty
            for a field of the user's own.

    Example:
        >>> pressure = Field(path="streams/tactile/pressure", dtype="float32", shape=("T", 2, 16, 16), unit="kPa")
        >>> pressure.grows, pressure.group
        (True, 'streams/tactile')
    """

    path: str
    dtype: str
    shape: tuple[Size, ...]
    unit: str = "-"
    doc: str = ""
    axes: str = "-"
    about: str = "-"
    components: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()
    bounds: tuple[tuple[float, float], ...] = ()
    delta: tuple[bool, ...] = ()
    image: bool = False
    possible: tuple[float, float] = (-LARGEST, LARGEST)
    assumed: tuple[str, ...] = ()
    name: str = ""

    def __post_init__(self) -> None:
        # A file gives tuples and floats back. Declarations of equal meaning must be equal, also those given as lists.
        for name in ("components", "delta", "possible", "assumed"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        sizes = (int(size) if isinstance(size, np.integer) else size for size in self.shape)
        object.__setattr__(self, "shape", tuple(sizes))
        object.__setattr__(self, "parts", tuple(Part(part.kind, tuple(part.index)) for part in self.parts))
        object.__setattr__(self, "bounds", tuple(map(_pair, self.bounds)))

    @functools.cached_property
    def group(self) -> str:
        """Path of the group of the array, whose arrays share a clock, such as ``streams/wrench``."""
        return self.path.rpartition("/")[0]

    @functools.cached_property
    def grows(self) -> bool:
        """Whether the array has a row per reading, rather than one value per episode."""
        return bool(self.shape) and isinstance(self.shape[0], str)

    @functools.cached_property
    def large(self) -> bool:
        """Whether the array may be so large that tools read it row by row: images, and rows of many numbers."""
        return self.image or math.prod(size for size in self.shape[1:] if isinstance(size, int)) > LARGE_ROW

    @property
    def rotates(self) -> str:
        """Transformation of the field under planar rotations and reflections, in words; ``-`` if there is none."""
        if self.image:
            return "pixels move"
        names = self.components or tuple(map(str, range(sum(len(part.index) for part in self.parts))))
        return parts_named(self.parts, names) if self.parts else "-"

    @functools.cached_property
    def numpy_dtype(self) -> np.dtype:
        """NumPy dtype of the array."""
        return np.dtype(self.dtype)

    @functools.cached_property
    def attributes(self) -> dict[str, str]:
        """Attributes of an HDF5 dataset that keep the declaration of its array, by name (`MEANING`)."""
        stored = Stored(
            list(self.shape), self.components, tuple((part.kind, part.index) for part in self.parts), self.bounds,
            self.delta, self.image, None if self.possible == (-LARGEST, LARGEST) else self.possible, self.assumed,
        )  # fmt: skip
        return {
            "unit": self.unit, "axes": self.axes, "about": self.about, "doc": self.doc,
            "declaration": msgspec.json.encode(stored).decode(),
        }  # fmt: skip

    @functools.cached_property
    def texts(self) -> tuple[str, ...]:
        """Values of the attributes that keep the declaration, in the order of `MEANING`."""
        return tuple(self.attributes[name] for name in MEANING)

    @property
    def shape_words(self) -> str:
        """Shape of the field as the documentation writes it, e.g. ``(N+1, 5)``."""
        return "(" + ", ".join(map(str, self.shape)) + ("," if len(self.shape) == 1 else "") + ")"


def _pair(bounds: Sequence[float]) -> Sequence[float]:
    """Return bounds as a file gives them back: floats in a tuple; what are no two numbers as it is (`field_fault`)."""
    try:
        low, high = bounds
        return float(low), float(high)
    except (TypeError, ValueError):
        return bounds


class Stored(msgspec.Struct, omit_defaults=True):
    """JSON form of what a declaration says besides its texts; see `Field` for the meaning of the attributes."""

    shape: list[int | str]
    components: tuple[str, ...] = ()
    parts: tuple[tuple[Kind, tuple[int, ...]], ...] = ()
    bounds: tuple[tuple[float, float], ...] = ()
    delta: tuple[bool, ...] = ()
    image: bool = False
    possible: tuple[int | float, int | float] | None = None
    assumed: tuple[str, ...] = ()


def parsed(path: str, dtype: str, texts: Sequence[str]) -> Field:
    """Return the declaration that a file keeps of an array.

    Args:
        path: Dataset path of the array.
        dtype: NumPy dtype of the array.
        texts: Values of the attributes `MEANING`, in this order.

    Raises:
        FieldError: If the declaration cannot be read.
    """
    if any(len(text) > TEXT_LIMIT for text in texts):
        raise FieldError(f"field {path} has a declaration of more than {TEXT_LIMIT} characters")
    unit, axes, about, doc, declaration = texts
    try:
        stored = msgspec.json.decode(declaration, type=Stored)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise FieldError(f"field {path} has a declaration that is not readable ({printable(error)})") from error
    return Field(
        path=path, dtype=dtype, shape=tuple(stored.shape), unit=unit, doc=doc, axes=axes, about=about,
        components=stored.components, parts=tuple(Part(kind, index) for kind, index in stored.parts),
        bounds=stored.bounds, delta=stored.delta, image=stored.image,
        possible=stored.possible or (-LARGEST, LARGEST), assumed=stored.assumed,
    )  # fmt: skip


def field_fault(field: Field) -> str | None:
    """Return what contradicts itself in a declaration, in words that follow its path; None if nothing does."""
    fault = _shape_fault(field) or _axis_fault(field) or _text_fault(field)
    return fault and printable(fault, FAULT_LENGTH)


def _shape_fault(field: Field) -> str | None:
    if len(field.shape) > DIMENSIONS:
        return f"has {len(field.shape)} dimensions; at most {DIMENSIONS} are possible"
    for size in field.shape:
        whole = isinstance(size, int) and not isinstance(size, bool) and 1 <= size <= LARGEST_SIZE
        if not whole and not (isinstance(size, str) and size.isprintable() and 0 < len(size) <= NAME_LENGTH):
            return f"has the size {size!r} in its shape; sizes are symbols, or numbers from 1 to {LARGEST_SIZE}"
    if not field.image:
        return None
    if not field.grows or len(field.shape) not in (3, 4):
        return f"is an image of shape {field.shape_words}; images have the shape (rows, H, W) or (rows, H, W, channels)"
    if field.parts or field.bounds or field.delta:
        return "is an image with parts, bounds or delta; these are of components, not of pixels"
    return None


def _axis_fault(field: Field) -> str | None:
    """Return what is wrong with what is declared of the components along the last axis."""
    last = field.shape[-1] if field.shape else "none"
    for name, values in (("components", field.components), ("bounds", field.bounds), ("delta", field.delta)):
        if values and len(values) != last:
            return f"declares {len(values)} {name}, but the size of its last axis is {last}"
    covered = sorted(index for part in field.parts for index in part.index)
    if field.parts and (len(covered) != last or any(index != place for place, index in enumerate(covered))):
        return f"has parts that cover the components {covered}, but its last axis has {last}: each must occur once"
    for part in field.parts:
        if part.kind not in get_args(Kind):
            return f"has a part of kind {part.kind!r}; possible are {', '.join(get_args(Kind))}"
        if not part.index or (part.kind in ("vector", "axial") and len(part.index) != 2):
            return f"has a part of kind {part.kind} with {len(part.index)} components; vector and axial have 2"
    for pair in (*field.bounds, field.possible):
        if not isinstance(pair, tuple) or len(pair) != 2:
            return f"has the bounds {pair!r}; bounds are pairs of a lower and an upper one, such as ((0, 1), (-2, 2))"
    if not all(-FARTHEST <= low < high <= FARTHEST for low, high in (*field.bounds, field.possible)):
        return f"has bounds that are not lower and upper, or beyond {FARTHEST:g}"
    return None


def _text_fault(field: Field) -> str | None:
    for name in field.components:
        if not name.isprintable() or not 0 < len(name) <= NAME_LENGTH:
            return f"has a component {name!r}; names are printable, of 1 to {NAME_LENGTH} characters"
    if unknown := set(field.assumed) - set(ASSUMABLE):
        return f"marks {', '.join(sorted(unknown))} as assumed; possible are {', '.join(ASSUMABLE)}"
    return None
