"""The metadata of an episode against one declared model: what is read from files and what programs give."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from svfl_data.errors import FieldError, FormatError
from svfl_data.schema.episode import Meta
from svfl_data.signals.transforms import TRANSFORMS, from_record
from svfl_data.system.printable import printable
from svfl_data.system.side_files import Int64, check_bounds, parse_as, parse_json, plain

PLAIN_ATTRIBUTES = ("task", "index", "seed", "source", "success")
JSON_ATTRIBUTES = ("config", "software", "transforms", "annotations", "history")


class Annotation(msgspec.Struct):
    """What an annotation must say; who found it and how is its own."""

    name: str
    start_ns: Int64
    end_ns: Int64


class Record(msgspec.Struct):
    """What the record of a transform must say: the parameters of those in `signals.transforms`, if it has them."""

    name: str
    offset: list[float] | None = None
    cutoff_hz: float | None = None
    mass_kg: float | None = None
    centre_m: list[float] | None = None


class HistoryEntry(msgspec.Struct):
    """What an entry of the history must say; what the tool did is its own."""

    tool: str


class Model(msgspec.Struct):
    """The types of `Meta`."""

    task: str
    index: Int64
    seed: Int64
    source: str
    success: bool
    config: dict[str, Any]
    software: dict[str, str]
    transforms: list[Record]
    annotations: list[Annotation]
    history: list[HistoryEntry]


def parse_meta(attributes: Mapping[str, Any], where: object) -> Meta:
    """What the attributes of an episode file say.

    Args:
        attributes: As HDF5 gives them.
        where: What to name in the error, such as the file.

    Raises:
        FormatError: If one is missing or of another type, is not JSON, or says what nothing can be made of.
    """
    try:
        meta = _checked({key: _attribute(attributes, key) for key in (*PLAIN_ATTRIBUTES, *JSON_ATTRIBUTES)})
        if meta.index < 0:  # a writer may leave its choice open, a file may not
            raise FormatError(f"attribute index is {meta.index}; episodes are numbered from 0")
        return meta
    except FormatError as error:
        raise FormatError(f"{where}: not a readable episode ({error})") from error


def checked_meta(meta: Meta) -> Meta:
    """Metadata that can be stored and read again, with Python's numbers in place of NumPy's.

    Args:
        meta: Given by a program.

    Raises:
        FieldError: If it cannot be stored, or says what nothing can be made of.
    """
    try:
        values = {field.name: getattr(meta, field.name) for field in dataclasses.fields(meta)}
        return _checked(plain(values, "attributes"))
    except (FormatError, FieldError) as error:
        raise FieldError(
            f"metadata of episode {printable(meta.index, 40)} cannot be stored as JSON ({error})"
        ) from error


def _attribute(attributes: Mapping[str, Any], key: str) -> Any:  # noqa: ANN401 - any JSON value
    """The value of an attribute as Python's number, text or JSON value."""
    if key not in attributes:
        raise FormatError(f"attribute {key} is missing")
    value = attributes[key]
    if isinstance(value, np.generic | np.ndarray) and np.ndim(value) == 0:
        value = value.item()
    if key in JSON_ATTRIBUTES:
        if not isinstance(value, str | bytes):
            raise FormatError(f"attribute {key} is a {type(value).__name__}, not JSON text")
        return parse_json(value, f"attribute {key}")
    check_bounds(value, f"attribute {key}", FormatError)
    return value


def _checked(values: dict[str, Any]) -> Meta:
    parse_as(values, Model, "attributes")
    for record in values["transforms"]:
        if record["name"] in TRANSFORMS:  # one of a later version can be kept, though not applied
            from_record(record, "attribute transforms")
    return Meta(**values)
