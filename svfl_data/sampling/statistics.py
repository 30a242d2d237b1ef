"""Statistics for scaling the inputs of a network: one scale per representation, from the training episodes only.

A mean is subtracted from invariants only, and both components of a vector have one scale. Otherwise scaling would not
commute with rotations and reflections (`svfl_data.symmetry`). The statistics are computed in one pass over the files,
chunk by chunk, and stored beside the split with the hash of the split and the hash of its training episodes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import fingerprint
from svfl_data.errors import DatasetError, FormatError
from svfl_data.sampling.moments import Moments
from svfl_data.sampling.split import Split, split_file
from svfl_data.schema.episode import canonical_json
from svfl_data.schema.field import Field
from svfl_data.storage.reader import EpisodeReader
from svfl_data.symmetry import Part
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable
from svfl_data.system.progress import progress
from svfl_data.system.regular_file import refuse_link
from svfl_data.system.side_files import check_format, parse_as, read_side_file

FORMAT = "svfl-statistics"
FORMAT_VERSION = "1.0"
TRAIN = "train"
ROWS_AT_ONCE, LARGE_ROWS_AT_ONCE = 2**16, 64
MEANT = ("shape", "unit", "axes", "about", "components", "parts")
"""Attributes of a declaration that all episodes must share."""
NOT_COUNTED = ("/t_ns", "/T_base_camera_per_frame")
"""Last parts of the paths of arrays without statistics: times, and poses, whose numbers have no common unit."""
CODED = {"uint8": 255.0}
"""Number of the brightest grey level of the images that are stored in this type; they are divided by it."""


@dataclass(frozen=True)
class FieldStatistics:
    """Statistics of one field; each list has one number per component of the field.

    Attributes:
        unit: Unit of the mean, the scale, the minimum and the maximum.
        count: Number of rows (for images, of pixels) that the statistics were taken from.
        mean: Mean to subtract from each component; zero unless the component is invariant.
        scale: Scale to divide each component by; the components of one representation have the same scale.
        min: Smallest value of each component.
        max: Largest value of each component.
    """

    unit: str
    count: Annotated[int, msgspec.Meta(ge=0)]
    mean: list[float]
    scale: list[Annotated[float, msgspec.Meta(gt=0)]]
    min: list[float]
    max: list[float]


class StatisticsFile(msgspec.Struct):
    """Fields that the file of statistics must contain besides its format and version."""

    split_sha256: str
    episodes_sha256: str
    fields: dict[str, FieldStatistics]


def compute_statistics(dataset: Dataset, episodes: Sequence[int]) -> dict[str, FieldStatistics]:
    """Compute the statistics of the fields of episodes, in one pass over their files.

    Readings of a group with a tare are tared, the position in proprioception is relative to the workspace centre,
    colour and grey of 8 bits are divided by 255, and depth is in metres, without the pixels that hold no measurement.

    Args:
        dataset: Dataset to read the episodes from.
        episodes: Indices of the episodes, such as the training part of a split.

    Returns:
        Statistics by field path, for the declared fields that all of the episodes have: observations, actions, the
        readings of each stream, the images of each camera, and labels with parts. Images and other large rows without
        components have one number for all their elements, except colour.

    Raises:
        DatasetError: If there are no episodes, or an episode is unfit for training.
        FormatError: If an episode is damaged.

    Example:
        >>> found = compute_statistics(dataset, [0, 1])
        >>> len(found["observations/proprio"].mean)
        5
    """
    if not episodes:
        raise DatasetError(f"{dataset.path}: no episodes to take statistics of")
    check_usable(dataset, episodes)
    moments: dict[str, Moments] = {}
    seen: dict[str, int] = {}
    declared: dict[str, Field] = {}
    for index in progress(episodes, "statistics"):
        reader = dataset.episode(index)
        for path, field in _summarised(reader).items():
            _check_same(declared.setdefault(path, field), field, reader)
            seen[path] = seen.get(path, 0) + 1
            for values in _values(reader, field):
                before = moments.get(path, Moments.none(values.shape[-1]))
                if len(before.mean) != values.shape[-1]:
                    raise DatasetError(f"{reader.extent}: {path} has other sizes than in the episodes before")
                moments[path] = before.and_also(values)
    common = {path: found for path, found in moments.items() if seen[path] == len(episodes)}
    return {path: _field_statistics(declared[path], found) for path, found in common.items()}


def save_statistics(dataset: Dataset, split: Split, found: dict[str, FieldStatistics]) -> Path:
    """Store the statistics of a split's training part beside the split.

    Args:
        dataset: Dataset that the split is stored in.
        split: Split whose training episodes the statistics were computed from.
        found: Statistics by field path, from `compute_statistics`.

    Returns:
        The file that was written; a previous file of statistics is replaced.

    Raises:
        StorageError: If the file cannot be written.
    """
    file = statistics_file(dataset, split.name)
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "split": split.name,
        "split_sha256": split.sha256,
        "part": TRAIN,
        "episodes_sha256": fingerprint(dataset, split[TRAIN]),
        "fields": {path: asdict(field) for path, field in found.items()},
    }
    refuse_link(file.parent)
    write_atomically(file, (canonical_json(content) + "\n").encode())
    return file


def load_statistics(dataset: Dataset, split: Split) -> dict[str, FieldStatistics]:
    """Load the stored statistics of a split, and check that they belong to this split and its training episodes.

    Args:
        dataset: Dataset that the split is stored in.
        split: Split whose statistics are loaded.

    Returns:
        Statistics by field path.

    Raises:
        DatasetError: If no statistics are stored, or they belong to another split or to other episodes.
        FormatError: If the file of statistics is damaged or has another format version.
    """
    file = statistics_file(dataset, split.name)
    refuse_link(file.parent)
    try:
        content = read_side_file(file)
    except FileNotFoundError as error:
        raise DatasetError(f"{dataset.path}: no statistics of split {split.name!r} yet") from error
    check_format(content, FORMAT, FORMAT_VERSION, file, "not readable as statistics")
    found = parse_as(content, StatisticsFile, f"{file}: not readable as statistics")
    for path, field in found.fields.items():
        if len({len(field.mean), len(field.scale), len(field.min), len(field.max)}) > 1:
            raise FormatError(f"{file}: fields.{printable(path, 80)}: its lists have different lengths")
    if found.split_sha256 != split.sha256:
        raise DatasetError(f"{file}: statistics of another split of this name; take them again")
    if found.episodes_sha256 != fingerprint(dataset, split[TRAIN]):
        raise DatasetError(f"{file}: the training episodes have changed since; take the statistics again")
    return found.fields


def statistics_file(dataset: Dataset, name: str) -> Path:
    """Return the file of the statistics of a split, whether or not the file exists.

    Args:
        dataset: Dataset that the split is stored in.
        name: Name of the split.
    """
    return split_file(dataset, name).with_suffix(".statistics.json")


def _summarised(reader: EpisodeReader) -> dict[str, Field]:
    """Return the declarations of the arrays that have statistics: rows of numbers, and labels that transform."""
    found = {}
    for path in reader.paths:
        field = reader.declarations.at(path)
        counted = field is not None and reader[path].dtype.kind in "iuf" and not path.endswith(NOT_COUNTED)
        if field and counted and (field.grows or (field.group == "labels" and field.parts)):
            found[path] = field
    return found


def _check_same(there: Field, here: Field, reader: EpisodeReader) -> None:
    """Check that the numbers of a field mean the same in an episode as in the episodes before."""
    for name in MEANT:
        if getattr(here, name) != getattr(there, name):
            raise DatasetError(
                f"{reader.extent}: {here.path} is declared with other {name} than in the episodes before, so that "
                "there are no statistics of both; svfl-data validate names the differences"
            )


def _values(reader: EpisodeReader, field: Field) -> Iterable[np.ndarray]:
    """Yield the values of a field in SI units, some rows at a time, each array of shape (..., C)."""
    array, group = reader[field.path], field.group
    if not field.grows:
        yield array[:].astype(np.float64)
        return
    tare = reader[f"{group}/tare"][:] if f"{group}/tare" in reader else None
    leaf = field.path.rpartition("/")[2]
    step = LARGE_ROWS_AT_ONCE if field.large else ROWS_AT_ONCE
    for row in range(0, len(array), step):
        block = array[row : row + step]
        if group.startswith("cameras/") and leaf == "depth":
            yield block[block > 0][:, None] * float(reader[f"{field.path}_scale"][()])  # (pixels, 1)
        elif field.image:
            values = block / np.float32(CODED.get(str(block.dtype), 1.0))
            yield values if leaf == "color" else values.reshape(-1, 1)
        elif (block.ndim > 2 and not field.components and not field.parts) or block.ndim == 1:
            yield block.reshape(-1, 1).astype(np.float64)
        else:
            values = block.astype(np.float64)
            if tare is not None and tare.shape == values.shape[1:]:
                values = values - tare
            if field.path == "observations/proprio" and "workspace" in reader:
                values[:, 1:3] -= reader["workspace"][:2].mean(axis=1)
            yield values


def _field_statistics(field: Field, found: Moments) -> FieldStatistics:
    parts = field.parts or tuple(Part("invariant", (channel,)) for channel in range(len(found.mean)))
    mean, scale = found.scaling(parts)
    depth = field.path.startswith("cameras/") and field.path.endswith("/depth")
    low, high = (found.low, found.high) if found.count else (mean, mean)
    unit = "m" if depth else field.unit
    return FieldStatistics(unit, found.count, mean.tolist(), scale.tolist(), low.tolist(), high.tolist())
