"""The declarations of the arrays of an episode: those of the standard fields, and those of the user's own."""

import functools
import re
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.action_fields import ACTION, EXPERT_ACTION
from svfl_data.schema.field import MEANING, Field, field_fault, parsed
from svfl_data.schema.fields import CAMERA, EXTRA, FIELDS, TIME, harmless
from svfl_data.system.printable import printable

OWN = re.compile(r"(observations|actions|labels|streams/[^/]+|cameras/[^/]+)/[^/]+")
LONE_CLOCK = re.compile(r"(streams/[^/]+)/t_ns")
PLACES = "observations/, actions/, labels/, streams/NAME/ or cameras/NAME/"
CHOSEN = (ACTION, EXPERT_ACTION)
"""Standard paths whose declaration each robot chooses; see `svfl_data.schema.action_fields`."""
LARGEST_ITEM = {"b": 1, "i": 8, "u": 8, "f": 8, "c": 16, "S": 2**15}
"""Largest size of an element by NumPy's kind of its type, [bytes]."""
CONTENT = ("dtype", "shape", "unit", "axes", "about", "components", "parts", "bounds", "delta", "image", "possible")
_STANDARD = {field.path: field for field in FIELDS}
_CLOCKS = {field.group: field.shape[0] for field in FIELDS if field.path.endswith("/t_ns")}
_CLOCKS["actions"] = "N"


class Declarations:
    """The declarations of an episode's arrays; those of the standard fields are always among them.

    Declarations are compared by value, and can be pickled and used as keys.

    Attributes:
        own: Declarations that are not standard, sorted by path: the user's own fields, another action than the
            planar one, and standard fields of which something is assumed.

    Example:
        >>> tactile = Field(path="streams/tactile/pressure", dtype="float32", shape=("T", 2, 16, 16), unit="kPa")
        >>> declared = Declarations([tactile])
        >>> declared.at("streams/tactile/pressure").unit, declared.at("streams/tactile/t_ns").unit
        ('kPa', 'ns')
    """

    def __init__(self, own: Iterable[Field] = ()) -> None:
        """Check the declarations.

        Args:
            own: Declarations of the user's own fields, and of the action if it is another than the planar one. A field
                of a stream or camera shares the clock ``t_ns`` of its group, which need not be declared. The first
                symbol of the shape stands for the rows of the group and may have any name.

        Raises:
            FieldError: If a declaration contradicts itself, another one or a standard field, or has an impossible path.
        """
        found: dict[str, Field] = {}
        for field in own:
            if field.path in found and found[field.path] != _whole(field):
                raise FieldError(f"field {field.path} is declared twice, in different ways")
            if fault := field_fault(field):
                raise FieldError(f"field {printable(field.path)} {fault}")
            _check_place(field)
            standard = standard_field(field.path)
            whole = _whole(field)
            if standard is None:
                found[field.path] = replace(whole, name="")
            elif field.path in CHOSEN or whole.assumed:
                found[field.path] = replace(whole, name=standard.name)
            if standard and field.path not in CHOSEN:
                _check_same(whole, standard)
        self.own = tuple(found[path] for path in sorted(found) if found[path] != standard_field(path))
        clocks = {field.group: _clock(field.group, field.shape[0]) for field in self.own if _has_own_clock(field)}
        self._own = {field.path: field for field in self.own} | {field.path: field for field in clocks.values()}
        self._hash = hash(self.own)

    def at(self, path: str) -> Field | None:
        """Return the declaration of an array; None for arrays below `EXTRA` and unknown ones.

        Args:
            path: Dataset path of the array.
        """
        return self._own.get(path) or standard_field(path) or _lone_clock(path)

    def image(self, path: str) -> bool:
        """Return whether the array at a dataset path is declared to hold images."""
        field = self.at(path)
        return field is not None and field.image

    def image_paths(self, camera: str, paths: Container[str]) -> list[str]:
        """Return the dataset paths of a camera's images, colour first.

        Args:
            camera: Name of the camera.
            paths: Dataset paths that were recorded.
        """
        return [field.path for field in self.in_group(f"cameras/{camera}") if field.image and field.path in paths]

    def names(self) -> dict[str, Field]:
        """Return the fields that do not belong to a camera, by the attribute of an episode or, without one, by path."""
        fields = [field for field in FIELDS if CAMERA not in field.path and field.path not in self._own]
        fields += [field for field in self._own.values() if not field.path.startswith("cameras/")]
        return {field.name or field.path: field for field in fields}

    @functools.lru_cache(maxsize=1024)  # noqa: B019 - declarations are few, and compared by value
    def in_group(self, group: str) -> tuple[Field, ...]:
        """Return the fields of a group, such as ``streams/wrench`` or ``cameras/front``, with their paths."""
        pattern = f"cameras/{CAMERA}" if group.startswith("cameras/") else group
        paths = [field.path.replace(pattern, group) for field in FIELDS if field.group == pattern]
        paths += [field.path for field in self._own.values() if field.group == group]
        return tuple(field for path in dict.fromkeys(paths) if (field := self.at(path)))

    def with_own(self, own: Iterable[Field]) -> "Declarations":
        """Return these declarations with further ones; a declaration of the same path is replaced."""
        return Declarations(({field.path: field for field in self.own} | {field.path: field for field in own}).values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Declarations) and self.own == other.own

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"Declarations({', '.join(field.path for field in self.own) or 'the standard fields'})"


@functools.lru_cache(maxsize=4096)
def standard_field(path: str) -> Field | None:
    """Return the declaration of a standard field; None if there is no standard field at the dataset path."""
    group, _, rest = path.partition("/")
    if group != "cameras":
        return _STANDARD.get(path)
    _, _, leaf = rest.partition("/")
    found = _STANDARD.get(f"cameras/{CAMERA}/{leaf}")
    return replace(found, path=path) if found else None


STANDARD = Declarations()
"""Declarations of the standard fields alone."""


def stored_declarations(arrays: Mapping[str, tuple[str, Mapping[str, Any]]]) -> Declarations:
    """Return the declarations that a file keeps.

    Args:
        arrays: Dtype and HDF5 attributes of each array, by dataset path.

    Raises:
        FieldError: If an array outside `EXTRA` is not declared, or a declaration cannot be read, contradicts itself or
            a standard field, or has an impossible path.
    """
    own = []
    for path, (dtype, found) in arrays.items():
        if path.startswith(EXTRA):
            continue
        texts = tuple(found.get(name) for name in MEANING)
        standard = standard_field(path)
        if standard and _same_text(texts, standard.texts):
            continue
        if standard and path not in CHOSEN and "assumed" not in str(texts[-1]):
            _refuse_texts(path, texts, standard.texts)
        missing = [name for name, text in zip(MEANING, texts, strict=True) if not isinstance(text, str)]
        if missing:
            raise FieldError(
                f"field {printable(path)} is not declared (attribute {missing[0]} is missing or no text); arrays "
                f"without a declaration belong below {EXTRA}"
            )
        own.append((path, dtype, *map(str, texts)))
    return _declarations(tuple(own)) if own else STANDARD


@functools.lru_cache(maxsize=64)
def _declarations(own: tuple[tuple[str, ...], ...]) -> Declarations:
    fields = [parsed(path, dtype, texts) for path, dtype, *texts in own]
    clocks = [field for field in fields if field.path.endswith("/t_ns") and standard_field(field.path) is None]
    made = Declarations(field for field in fields if field not in clocks)
    for clock in clocks:
        if (expected := made.at(clock.path)) is None:
            raise FieldError(f"field {clock.path} is a clock of no declared array")
        _check_same(clock, expected)
    return made


def _same_text(found: tuple[Any, ...], standard: tuple[str, ...]) -> bool:
    doc = MEANING.index("doc")
    return found[:doc] == standard[:doc] and found[doc + 1 :] == standard[doc + 1 :]


def _refuse_texts(path: str, found: tuple[Any, ...], standard: tuple[str, ...]) -> None:
    """Raise an error that names the first attribute in which a standard field differs from its declaration."""
    for name, here, there in zip(MEANING, found, standard, strict=True):
        if here != there and name != "doc":
            raise FieldError(f"field {path} has {name} {printable(repr(here), 100)}, expected {there!r}")


def _check_place(field: Field) -> None:
    path = printable(field.path)
    if not harmless(field.path) or (not OWN.fullmatch(field.path) and standard_field(field.path) is None):
        raise FieldError(f"field {path} cannot be declared there; fields of your own belong in {PLACES}")
    if field.path.endswith("/t_ns") and standard_field(field.path) is None:
        raise FieldError(f"field {path} need not be declared: every group has its clock")
    try:
        dtype = np.dtype(field.dtype)
        plain = dtype.isnative and 0 < dtype.itemsize <= LARGEST_ITEM.get(dtype.kind, 0)
    except (TypeError, ValueError, SyntaxError):
        plain = False
    if not plain:
        raise FieldError(
            f"field {path} has dtype {printable(field.dtype)}; possible are numbers, booleans and byte "
            "strings in the byte order of this machine"
        )
    rows = field.group in ("observations", "actions")
    if rows and not field.grows:
        raise FieldError(f"field {path} has the shape {field.shape_words}; its first size must stand for the steps")
    if field.image and dtype.kind not in "biuf":
        raise FieldError(f"field {path} has dtype {dtype}; the pixels of an image are real numbers")
    numbers = dtype.kind in "iuf"
    if field.group == "actions" and not (numbers and len(field.shape) == 2 and isinstance(field.shape[1], int)):
        raise FieldError(
            f"field {path} has dtype {printable(field.dtype)} and shape {field.shape_words}; an action is a row of a "
            "fixed number of numbers"
        )
    if field.group == "labels" and field.grows:
        raise FieldError(f"field {path} has rows, but an episode has each label once")


def _whole(field: Field) -> Field:
    """Return a declaration with the symbol of its group in the place of its rows, and its dtype as NumPy names it."""
    dtype = str(np.dtype(field.dtype)) if np.dtype(field.dtype).kind != "S" else np.dtype(field.dtype).str
    if not field.grows:
        return replace(field, dtype=dtype)
    group = f"cameras/{CAMERA}" if field.path.startswith("cameras/") else field.group
    return replace(field, dtype=dtype, shape=(_CLOCKS.get(group, "T"), *field.shape[1:]))


def _check_same(field: Field, standard: Field) -> None:
    """Raise an error if a standard field is declared with another meaning than the standard one."""
    for name in CONTENT:
        here, there = getattr(field, name), getattr(standard, name)
        if here != there:
            raise FieldError(f"field {field.path} has {name} {printable(repr(here), 100)}, expected {there!r}")


def _has_own_clock(field: Field) -> bool:
    return field.path.startswith("streams/") and field.grows and field.group not in _CLOCKS


@functools.lru_cache(maxsize=1024)
def _lone_clock(path: str) -> Field | None:
    """Return the declaration of the clock of a stream of which nothing else is there, as after a crash."""
    match = LONE_CLOCK.fullmatch(path)
    return _clock(match[1], "T") if match else None


def _clock(group: str, symbol: int | str) -> Field:
    return Field(
        path=f"{group}/t_ns", dtype="int64", shape=(symbol,), unit="ns", doc="Time of each row, episode clock.",
        possible=TIME,
    )  # fmt: skip


def wrench_stream(name: str, axes: str = "sensor", about: str = "sensor origin", doc: str = "") -> list[Field]:
    """Return the declarations of a further wrench sensor: its readings and its tare, as ``streams/<name>/...``.

    Args:
        name: Name of the stream.
        axes: Axes in which force and torque are expressed. Only those of the base rotate with the plane.
        about: Point about which torques are taken.
        doc: Description of the sensor.

    Example:
        >>> [field.path for field in wrench_stream("wrist_left", axes="base")]
        ['streams/wrist_left/wrench', 'streams/wrist_left/tare']
    """
    raw, tare = _STANDARD["streams/wrench/wrench"], _STANDARD["streams/wrench/tare"]
    parts = raw.parts if axes == "base" else ()
    return [
        replace(one, path=f"streams/{name}/{leaf}", name="", axes=axes, about=about, parts=parts, doc=doc or one.doc)
        for leaf, one in (("wrench", raw), ("tare", tare))
    ]
