"""The recording setup, which all episodes of a dataset share, and the only comparison between setups.

Cameras (names, image sizes, calibration), workspace, declared rates and the row shapes of streams are compared between
episodes by every tool that writes a dataset, combines episodes or learns from them. The episode (``config.varies``,
from `EpisodeWriter`) or the dataset (``varies`` in ``dataset.json``) declares what may differ on purpose.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.schema.declarations import CHOSEN, STANDARD, Declarations, standard_field
from svfl_data.schema.episode import Meta
from svfl_data.schema.field import MEANING, Field

TOLERANCE = 1e-9
"""Largest difference between two numbers of a setup that count as equal, in their unit; for numbers above 1 it is
relative. The rounding of another processor causes differences of this size, whereas a camera that has really moved
is off by more than a nanometre."""
RATES = "rates_hz/"
"""Prefix of the name of a group that stands for the declared rate of the group."""
DECLARED = "declaration/"
"""Prefix of the path of an array that stands for the array's declaration."""
COMPARED = tuple(name for name in MEANING if name != "doc")
"""Attributes of a declaration that episodes of a dataset must share."""


class Array(Protocol):
    """Protocol of an array in memory or on disk, as far as this module needs one."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the array."""

    @property
    def dtype(self) -> np.dtype:
        """Type of the elements of the array."""

    def __getitem__(self, key: tuple[()], /) -> Any: ...  # noqa: ANN401 - NumPy's


class Setup(msgspec.Struct, frozen=True):
    """Recording setup of an episode, which it shares with the others of its dataset.

    Attributes:
        numbers: Calibration of the cameras, workspace and declared rates by path, each as a flat list of numbers. The
            path of a rate is `RATES` and the group.
        rows: Type and shape of one row by path, for arrays whose row shape is not fixed, such as images and joint
            positions.
        declared: Declarations that are not standard, as the texts `COMPARED`, by `DECLARED` and the path.
        varies: Paths and groups in which the episode may differ from others.
    """

    numbers: dict[str, list[float]] = {}
    rows: dict[str, tuple[str, list[int]]] = {}
    declared: dict[str, tuple[str, ...]] = {}
    varies: list[str] = []

    @classmethod
    def of(cls, meta: Meta, arrays: Mapping[str, Array], declarations: Declarations = STANDARD) -> "Setup":
        """Return the setup of a recorded episode, or the part of it that is known before the episode is recorded.

        Args:
            meta: Metadata of the episode.
            arrays: Arrays of the episode by dataset path. Only those that belong to the setup are read.
            declarations: Declarations of the arrays.
        """
        rates, varies = meta.config.get("rates_hz"), meta.config.get("varies")
        declared = rates.items() if isinstance(rates, dict) else ()
        return cls(
            {f"{RATES}{group}": [float(rate)] for group, rate in declared if isinstance(rate, int | float)}
            | _numbers(arrays, declarations),
            _rows(arrays, declarations),
            {f"{DECLARED}{field.path}": _texts(field) for field in declarations.own},
            [path for path in varies if isinstance(path, str)] if isinstance(varies, list) else [],
        )

    def with_arrays(self, arrays: Mapping[str, Array], declarations: Declarations = STANDARD) -> "Setup":
        """Return this setup, extended by the facts that more arrays hold.

        Args:
            arrays: Arrays of the same episode by dataset path.
            declarations: Declarations of the arrays.
        """
        return msgspec.structs.replace(
            self,
            numbers={**self.numbers, **_numbers(arrays, declarations)},
            rows={**self.rows, **_rows(arrays, declarations)},
        )

    def facts(self) -> dict[str, Any]:
        """Return all facts by name; an action that is not declared is the standard one."""
        standard = {f"{DECLARED}{path}": _texts(field) for path in CHOSEN if (field := standard_field(path))}
        return {**self.numbers, **self.rows, **standard, **self.declared}

    @property
    def cameras(self) -> set[str]:
        """Names of the cameras of the episode."""
        return {path.split("/")[1] for path in self.numbers if path.startswith("cameras/")}


def _numbers(arrays: Mapping[str, Array], declarations: Declarations) -> dict[str, list[float]]:
    """Return the numbers that all episodes share, which describe a camera or the whole workspace, by path."""
    found = {}
    for path in arrays:
        field = declarations.at(path)
        if field and not field.grows and (path == "workspace" or path.startswith("cameras/")):
            found[path] = np.ravel(np.asarray(arrays[path][()], np.float64)).tolist()
    return found


def _texts(field: Field) -> tuple[str, ...]:
    return tuple(field.attributes[name] for name in COMPARED)


def _rows(arrays: Mapping[str, Array], declarations: Declarations) -> dict[str, tuple[str, list[int]]]:
    found = {}
    for path in arrays:
        field = declarations.at(path)
        if field and any(isinstance(size, str) for size in field.shape[1:]):
            found[path] = str(arrays[path].dtype), list(arrays[path].shape[1:])
    return found


@dataclass(frozen=True)
class Difference:
    """One fact in which an episode differs from the others.

    Attributes:
        name: Dataset path, or `RATES` and a group.
        here: Value of the fact in this episode, in words.
        there: Value of the fact in the other episodes, in words.
        where: Name of one of the other episodes.
    """

    name: str
    here: str
    there: str
    where: str

    def __str__(self) -> str:
        return f"{self.name} is {self.here}, but {self.there} in {self.where}"


class Common:
    """Facts that setups have in common: the first value that was seen of each fact, and the episode that has it.

    Args:
        varies: Paths and groups that are not compared, besides those that the setups themselves declare.
        cameras: Names of the cameras that are compared. None for all cameras.
    """

    def __init__(self, varies: Collection[str] = (), cameras: Collection[str] | None = None) -> None:
        self.varies = set(varies)
        self._chosen = None if cameras is None else set(cameras)
        self._facts: dict[str, tuple[str, Any]] = {}
        self._first: tuple[str, set[str]] | None = None  # name of the first episode, and names of its cameras

    def add(self, setup: Setup, where: str) -> None:
        """Add the facts of a setup that no earlier setup has stated.

        Args:
            setup: Recording setup of an episode.
            where: Name of the episode in messages.
        """
        self.varies |= set(setup.varies)
        self._first = self._first or (where, setup.cameras)
        for name, value in setup.facts().items():
            self._facts.setdefault(name, (where, value))

    def differences(self, setup: Setup, whole: bool = True) -> Iterator[Difference]:
        """Yield the facts in which a setup differs from those that were added before.

        Args:
            setup: Recording setup of another episode.
            whole: Whether the episode is complete. If True, an array of a camera that is absent from the setup is a
                difference, too.
        """
        if self._first is None:
            return
        where, cameras = self._first
        for camera in sorted(cameras ^ setup.cameras):
            if self._compared(f"cameras/{camera}/intrinsics", setup):
                words = ("missing", "present") if camera in cameras else ("present", "missing")
                yield Difference(f"cameras/{camera}", *words, where)
        own = setup.facts()
        for name, (where, value) in self._facts.items():
            if not self._compared(name, setup):
                continue
            if name in own and not _same(own[name], value):
                yield Difference(name, *_words(name, own[name], value), where)
            elif whole and name not in own and name.startswith("cameras/") and name.split("/")[1] in setup.cameras:
                yield Difference(name, "missing", "present", where)

    def _compared(self, name: str, setup: Setup) -> bool:
        path = name.removeprefix(RATES).removeprefix(DECLARED)
        if self._chosen is not None and path.startswith("cameras/") and path.split("/")[1] not in self._chosen:
            return False
        varies = self.varies | set(setup.varies)
        return path not in varies and path.rpartition("/")[0] not in varies


def first_difference(setups: Sequence[tuple[str, Setup]], common: Common) -> tuple[str, Difference] | None:
    """Return the first episode that differs from those before it, and the difference, or None if all agree.

    Args:
        setups: Name and recording setup of each episode, in order.
        common: Facts with which the setups are compared. The facts of the setups that agree are added to it.
    """
    common.varies |= {path for _, setup in setups for path in setup.varies}
    for where, setup in setups:
        for difference in common.differences(setup):
            return where, difference
        common.add(setup, where)
    return None


def refuse_difference(found: tuple[str, Difference] | None, task: str, way: str) -> None:
    """Raise an error that says in what an episode differs from the others, if there is a difference.

    Args:
        found: Result of `first_difference`.
        task: What cannot be done because of the difference, in words that follow "cannot".
        way: What the user can do about the difference, with ``{name}`` in place of the fact that differs.

    Raises:
        DatasetError: If there is a difference.
    """
    if found:
        where, difference = found
        raise DatasetError(
            f"cannot {task}: {difference.name} is {difference.here} in {where}, but {difference.there} in "
            f"{difference.where}; {way.format(name=difference.name.removeprefix(RATES).removeprefix(DECLARED))}"
        )


def _same(here: Any, there: Any) -> bool:  # noqa: ANN401 - a fact
    if isinstance(here, list) and isinstance(there, list):
        return len(here) == len(there) and all(
            abs(a - b) <= TOLERANCE * max(1.0, abs(b)) for a, b in zip(here, there, strict=True)
        )
    return bool(here == there)


def _words(name: str, here: Any, there: Any) -> tuple[str, str]:  # noqa: ANN401 - facts
    """Return both values of a fact in words. For a matrix, this is the number that differs most."""
    if name.startswith(DECLARED):
        which = next(at for at in range(len(COMPARED)) if here[at] != there[at])
        if COMPARED[which] == "declaration":
            return _declared_words(here[which], there[which])
        return f"{COMPARED[which]} {here[which]!r}", f"{COMPARED[which]} {there[which]!r}"
    if not isinstance(here, list):
        return _row_words(here), _row_words(there)
    field = standard_field(name)
    if len(here) != len(there):
        return f"{len(here)} numbers", f"{len(there)}"
    position = int(np.argmax(np.abs(np.subtract(here, there))))
    sizes = [size for size in field.shape if isinstance(size, int)] if field else []
    place = ""
    if int(np.prod(sizes)) == len(here) > 1:
        place = f" at {[int(index) for index in np.unravel_index(position, sizes)]}"
    return f"{here[position]!r}{place}", f"{there[position]!r}"


def _declared_words(here: str, there: str) -> tuple[str, str]:
    """Return the first attribute in which two declarations differ (`svfl_data.schema.field.Stored`), in words."""
    found, others = (msgspec.json.decode(text) for text in (here, there))
    name = next(name for name in [*found, *others] if found.get(name) != others.get(name))
    return f"{name} {found.get(name, 'not declared')}", f"{name} {others.get(name, 'not declared')}"


def _row_words(row: tuple[str, Sequence[int]]) -> str:
    dtype, shape = row
    return f"{dtype} {tuple(shape)}"
