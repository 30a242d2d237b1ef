"""Checks of an episode's metadata against one declared model, whether a file or a program gives them."""

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

PLAIN_ATTRIBUTES = ("task", "index", "seed", "source", "success", "instruction", "robot", "operator")
JSON_ATTRIBUTES = ("config", "software", "transforms", "annotations", "history")


class Annotation(msgspec.Struct):
    """Keys that every annotation must have. Other keys, such as who found it and how, are free."""

    name: str
    start_ns: Int64
    end_ns: Int64


class Record(msgspec.Struct):
    """Keys of the record of a transform: its name, and any parameters of those in `svfl_data.signals.transforms`."""

    name: str
    offset: list[float] | None = None
    cutoff_hz: float | None = None
    mass_kg: float | None = None
    centre_m: list[float] | None = None


class HistoryEntry(msgspec.Struct):
    """Keys that every entry of the history must have. Other keys, such as what the tool did, are free."""

    tool: str


class Model(msgspec.Struct):
    """Types of the attributes of `svfl_data.schema.episode.Meta`, as they are checked."""

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
    instruction: str
    robot: str
    operator: str


def parse_meta(attributes: Mapping[str, Any], where: object) -> Meta:
    """Read the metadata of an episode from the attributes of its file.

    Args:
        attributes: Attributes of the file by name, as HDF5 gives them.
        where: Source of the attributes, such as the file, as the error message names it.

    Raises:
        FormatError: If an attribute is missing, has a wrong type, is not JSON where JSON is expected, or has a value
            that is not possible.
    """
    try:
        meta = _checked({key: _attribute(attributes, key) for key in (*PLAIN_ATTRIBUTES, *JSON_ATTRIBUTES)})
        if meta.index < 0:  # a writer may leave the index open (-1), a file may not
            raise FormatError(f"attribute index is {meta.index}; episodes are numbered from 0")
        return meta
    except FormatError as error:
        raise FormatError(f"{where}: not a readable episode ({error})") from error


def checked_meta(meta: Meta) -> Meta:
    """Return metadata that can be stored and read again, with Python's numbers in place of NumPy's.

    Args:
        meta: Metadata as a program gives them.

    Raises:
        FieldError: If the metadata cannot be stored as JSON, or have a value of a wrong type or one that is not
            possible.
    """
    try:
        values = {field.name: getattr(meta, field.name) for field in dataclasses.fields(meta)}
        return _checked(plain(values, "attributes"))
    except (FormatError, FieldError) as error:
        raise FieldError(
            f"metadata of episode {printable(meta.index, 40)} cannot be stored as JSON ({error})"
        ) from error


def _attribute(attributes: Mapping[str, Any], key: str) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of an attribute as a Python number, a text or a JSON value."""
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
        if record["name"] in TRANSFORMS:  # a transform of a later version can be kept, but not applied
            from_record(record, "attribute transforms")
    return Meta(**values)
