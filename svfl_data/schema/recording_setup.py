"""With what an episode was recorded, and the one comparison of it: episodes of a dataset share all of this.

Cameras (names, image sizes, calibration), workspace, declared rates and the row shapes of streams are compared between
episodes by everything that writes a dataset, puts episodes together or learns from them. What may differ on purpose is
said by the episode (``config.varies``, from `EpisodeWriter`) or by the dataset (``varies`` in ``dataset.json``).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.schema.episode import Meta
from svfl_data.schema.fields import field_at

TOLERANCE = 1e-9
"""Calibrations that differ by no more than this, in their units, count as equal: that much is another processor's
rounding. A camera that has really moved is off by more than a nanometre."""
RATES = "rates_hz/"
"""Before the name of a group: its declared rate."""


class Array(Protocol):
    """What is asked of an array in memory or on disk."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its sizes."""

    @property
    def dtype(self) -> np.dtype:
        """Type of its elements."""

    def __getitem__(self, key: tuple[()], /) -> Any: ...  # noqa: ANN401 - NumPy's


class Setup(msgspec.Struct, frozen=True):
    """What an episode shares with the others of its dataset.

    Attributes:
        numbers: Calibration of cameras, workspace and declared rates, each as a flat list of its numbers, by path.
        rows: Type and shape of a row of what has no fixed one, such as images and joint positions, by path.
        varies: Paths and groups in which it may differ from others.
    """

    numbers: dict[str, list[float]] = {}
    rows: dict[str, tuple[str, list[int]]] = {}
    varies: list[str] = []

    @classmethod
    def of(cls, meta: Meta, arrays: Mapping[str, Array]) -> "Setup":
        """The setup of an episode that was recorded, or of what is known of one before it is.

        Args:
            meta: What it is about.
            arrays: Its arrays by dataset path; only those that matter are read.
        """
        rates, varies = meta.config.get("rates_hz"), meta.config.get("varies")
        declared = rates.items() if isinstance(rates, dict) else ()
        return cls(
            {f"{RATES}{group}": [float(rate)] for group, rate in declared if isinstance(rate, int | float)}
            | {path: np.ravel(np.asarray(arrays[path][()], np.float64)).tolist() for path in arrays if _shared(path)},
            _rows(arrays),
            [path for path in varies if isinstance(path, str)] if isinstance(varies, list) else [],
        )

    def with_arrays(self, arrays: Mapping[str, Array]) -> "Setup":
        """The same with more arrays."""
        numbers = {path: np.ravel(np.asarray(arrays[path][()])).tolist() for path in arrays if _shared(path)}
        return Setup({**self.numbers, **numbers}, {**self.rows, **_rows(arrays)}, self.varies)

    @property
    def cameras(self) -> set[str]:
        """Names of the cameras."""
        return {path.split("/")[1] for path in self.numbers if path.startswith("cameras/")}


def _shared(path: str) -> bool:
    """Whether an array holds numbers that all episodes share: those that hold for a camera or the whole workspace."""
    field = field_at(path)
    grows = bool(field and field.shape and isinstance(field.shape[0], str))
    return field is not None and not grows and (path == "workspace" or path.startswith("cameras/"))


def _rows(arrays: Mapping[str, Array]) -> dict[str, tuple[str, list[int]]]:
    found = {}
    for path in arrays:
        field = field_at(path)
        if field and any(isinstance(size, str) for size in field.shape[1:]):
            found[path] = str(arrays[path].dtype), list(arrays[path].shape[1:])
    return found


@dataclass(frozen=True)
class Difference:
    """A fact in which an episode is unlike the others.

    Attributes:
        name: Dataset path, or `RATES` and a group.
        here: What it is in this episode, in words.
        there: What it is in the others.
        where: One of them.
    """

    name: str
    here: str
    there: str
    where: str

    def __str__(self) -> str:
        return f"{self.name} is {self.here}, but {self.there} in {self.where}"


class Common:
    """What setups have in common: of each fact the first value that was seen, and where.

    Args:
        varies: Paths and groups that are not compared, beside what the setups themselves say.
        cameras: The cameras that matter; all if None.
    """

    def __init__(self, varies: Collection[str] = (), cameras: Collection[str] | None = None) -> None:
        self.varies = set(varies)
        self._chosen = None if cameras is None else set(cameras)
        self._facts: dict[str, tuple[str, Any]] = {}
        self._first: tuple[str, set[str]] | None = None  # where, and names of the cameras there

    def add(self, setup: Setup, where: str) -> None:
        """Take in what a setup says that none has said before."""
        self.varies |= set(setup.varies)
        self._first = self._first or (where, setup.cameras)
        for name, value in [*setup.numbers.items(), *setup.rows.items()]:
            self._facts.setdefault(name, (where, value))

    def differences(self, setup: Setup, whole: bool = True) -> Iterator[Difference]:
        """In what a setup is unlike those before.

        Args:
            setup: Of another episode.
            whole: Whether the episode is complete: what it lacks of a camera then, it does not have.
        """
        if self._first is None:
            return
        where, cameras = self._first
        for camera in sorted(cameras ^ setup.cameras):
            if self._compared(f"cameras/{camera}/intrinsics", setup):
                words = ("missing", "there") if camera in cameras else ("there", "missing")
                yield Difference(f"cameras/{camera}", *words, where)
        own = {**setup.numbers, **setup.rows}
        for name, (where, value) in self._facts.items():
            if not self._compared(name, setup):
                continue
            if name in own and not _same(own[name], value):
                yield Difference(name, *_words(name, own[name], value), where)
            elif whole and name not in own and name.startswith("cameras/") and name.split("/")[1] in setup.cameras:
                yield Difference(name, "missing", "there", where)

    def _compared(self, name: str, setup: Setup) -> bool:
        path = name.removeprefix(RATES)
        if self._chosen is not None and path.startswith("cameras/") and path.split("/")[1] not in self._chosen:
            return False
        varies = self.varies | set(setup.varies)
        return path not in varies and path.rpartition("/")[0] not in varies


def first_difference(setups: Sequence[tuple[str, Setup]], common: Common) -> tuple[str, Difference] | None:
    """The first episode that is unlike those before it, and in what; None if all agree.

    Args:
        setups: Where from, and what, in order.
        common: What they are compared with; afterwards what they have in common.
    """
    common.varies |= {path for _, setup in setups for path in setup.varies}
    for where, setup in setups:
        for difference in common.differences(setup):
            return where, difference
        common.add(setup, where)
    return None


def refuse_difference(found: tuple[str, Difference] | None, task: str, way: str) -> None:
    """Say in what an episode is unlike the others.

    Args:
        found: From `first_difference`.
        task: What cannot be done then, in words.
        way: What can be done about it, with ``{name}`` for what differs.

    Raises:
        DatasetError: If there is a difference.
    """
    if found:
        where, difference = found
        raise DatasetError(
            f"cannot {task}: {difference.name} is {difference.here} in {where}, but {difference.there} in "
            f"{difference.where}; {way.format(name=difference.name.removeprefix(RATES))}"
        )


def _same(here: Any, there: Any) -> bool:  # noqa: ANN401 - a fact
    if isinstance(here, list) and isinstance(there, list):
        return len(here) == len(there) and all(
            abs(a - b) <= TOLERANCE * max(1.0, abs(b)) for a, b in zip(here, there, strict=True)
        )
    return bool(here == there)


def _words(name: str, here: Any, there: Any) -> tuple[str, str]:  # noqa: ANN401 - facts
    """Both values of a fact in words; of a matrix, the number that differs most."""
    if not isinstance(here, list):
        return _row_words(here), _row_words(there)
    field = field_at(name)
    if len(here) != len(there):
        return f"{len(here)} numbers", f"{len(there)}"
    position = int(np.argmax(np.abs(np.subtract(here, there))))
    sizes = [size for size in field.shape if isinstance(size, int)] if field else []
    place = ""
    if int(np.prod(sizes)) == len(here) > 1:
        place = f" at {[int(index) for index in np.unravel_index(position, sizes)]}"
    return f"{here[position]!r}{place}", f"{there[position]!r}"


def _row_words(row: tuple[str, Sequence[int]]) -> str:
    dtype, shape = row
    return f"{dtype} {tuple(shape)}"
