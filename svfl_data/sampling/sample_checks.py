"""Checks of stored arrays before samples are read from them: shapes, crops, memory, and times that do not decrease."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from svfl_data.errors import DatasetError, UsageError
from svfl_data.storage.reader import StoredArray

Stored = Sequence[Mapping[str, StoredArray]]
"""Arrays of each episode by dataset path; all episodes have the same paths."""


def require_shapes(stored: Stored, whole: Collection[str], images: Collection[str], crop: int | None) -> None:
    """Refuse episodes whose arrays do not fit into one batch, and crops that do not fit into the images.

    Args:
        stored: Arrays of each episode.
        whole: Paths of the arrays that an episode has once, whose shapes must be equal as a whole; of the others the
            number of rows may differ.
        images: Paths of the images.
        crop: Height and width of the crops, [px]; None for whole images.

    Raises:
        DatasetError: If two episodes differ.
        UsageError: If the crop is larger than the images.
    """
    for path, array in stored[0].items():
        rows = 0 if path in whole or not array.shape else 1
        for other in stored[1:]:
            if other[path].shape[rows:] != array.shape[rows:]:
                raise DatasetError(
                    f"{path} is {array.shape[rows:]} in {array.extent}, but {other[path].shape[rows:]} in "
                    f"{other[path].extent}; a batch needs equal shapes"
                )
        if crop and path in images and not 1 <= crop <= min(array.shape[1:3]):
            raise UsageError(f"crop is {crop} px; {path} has {array.shape[1]} x {array.shape[2]} px")


def require_memory(stored: Stored, images: Collection[str], cached: bool, budget: int, source: object) -> None:
    """Refuse arrays that take more memory than they may.

    Args:
        stored: Arrays of each episode.
        images: Paths of the images.
        cached: Whether the images are kept in memory as well.
        budget: Largest memory, [bytes].
        source: Name of the dataset in the message.

    Raises:
        DatasetError: If the arrays need more than the budget.
    """
    small = pictures = 0
    for path, array in ((path, array) for of_episode in stored for path, array in of_episode.items()):
        size = int(np.prod(array.shape, dtype=np.int64)) * array.dtype.itemsize
        small, pictures = (small, pictures + size) if path in images else (small + size, pictures)
    need = small + (pictures if cached else 0)
    if need > budget:
        way = "cache=False, " if cached else ""
        raise DatasetError(
            f"{source}: samples need {need / 1e6:.3g} MB of memory ({pictures / 1e6:.3g} MB of images), "
            f"the budget is {budget / 1e6:.3g} MB; choose {way}fewer episodes or a larger budget"
        )


def checked_values(array: StoredArray) -> np.ndarray:
    """Return a whole array, after checking that it does not run backwards if it holds time stamps.

    Args:
        array: Stored array.

    Raises:
        DatasetError: If time stamps decrease.
    """
    values = array[()]
    if array.path.endswith("/t_ns") and (np.diff(values) < 0).any():
        row = int(np.flatnonzero(np.diff(values) < 0)[0]) + 1
        raise DatasetError(
            f"{array.extent}: {array.path} decreases at row {row}; samples need time stamps that do not decrease"
        )
    return values
