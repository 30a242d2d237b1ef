"""Checks that all episodes of a dataset have the same setup, those that are sealed and those that are being recorded.

The setup of a dataset is not stored separately. It follows from the sealed episodes (through the index, so that they
need not be opened again) and from the writers that are running. Each writer keeps its setup in a file beside its
journal, which is valid as long as the lock of the journal is held. So discarded recordings and deleted episodes have no
effect on later ones.
"""

import os
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import entries, known_entries
from svfl_data.datasets.recording_setup import (
    DECLARED,
    RATES,
    Array,
    Common,
    Setup,
    first_difference,
    refuse_difference,
)
from svfl_data.errors import DatasetError, FormatError, StorageError
from svfl_data.recording.index_locks import SETUP, inflight, locked, take_over
from svfl_data.recording.journal import SUFFIX as JOURNAL
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Meta
from svfl_data.system.regular_file import open_regular
from svfl_data.system.side_files import parse_as, read_side_file


class Agreement:
    """The setup of one writer, which is compared with the setups of the dataset's other episodes.

    Args:
        dataset: Dataset into which the writer records.
        journal: Path of the writer's journal, which must be locked.
        meta: Metadata of the writer's episode.
        constants: Calibration and other arrays that the episode has once, by dataset path.
        declarations: Declarations of the episode's arrays.

    Raises:
        DatasetError: If sealed episodes, or episodes that are being recorded now, have a different setup.
        FormatError: If the folder is not a dataset any more.
        StorageError: If the disk refuses.
    """

    def __init__(
        self, dataset: Dataset, journal: Path, meta: Meta, constants: Mapping[str, Array], declarations: Declarations
    ) -> None:
        self._dataset, self._file = dataset, journal.with_suffix(SETUP)
        self._declarations = declarations
        self._setup = Setup.of(meta, constants, declarations)
        self._sealed: list[tuple[str, Setup]] = []
        self._lock = threading.Lock()  # several threads append to an episode
        self._hold(self._setup, fresh=True)

    def extend(self, arrays: Mapping[str, Array]) -> None:
        """Compare the first rows of a stream with those of other episodes, and add them to the setup if they agree.

        Args:
            arrays: First rows of each array of the stream, by dataset path.

        Raises:
            DatasetError: If other episodes have rows of another type or shape; the setup is then unchanged.
            FormatError: If the folder is not a dataset any more.
            StorageError: If the disk refuses.
        """
        with self._lock:
            self._hold(self._setup.with_arrays(arrays, self._declarations))

    def confirm(self, constants: Mapping[str, Array]) -> None:
        """Compare the setup of the whole episode, before it is sealed, with the episodes that were sealed meanwhile.

        Args:
            constants: Constant arrays that became known while recording, by dataset path.

        Raises:
            DatasetError: If another episode has a different setup; the recorded readings are intact.
        """
        with self._lock:
            self._hold(self._setup.with_arrays(constants, self._declarations), fresh=True, whole=True)

    def leave(self) -> None:
        """Remove the setup file of the writer, which has ended."""
        self._file.unlink(missing_ok=True)

    def _hold(self, setup: Setup, fresh: bool = False, whole: bool = False) -> None:
        with locked(inflight(self._dataset.path)):
            if fresh:
                self._sealed = [(f"episode {entry.index}", entry.setup) for entry in known_entries(self._dataset)]
            common = Common(self._dataset.varies)
            for where, other in [*self._sealed, *self._living()]:
                common.add(other, where)
            for found in common.differences(setup, whole):
                kept = "; what was recorded is kept, and svfl-data repair makes an episode of it" if whole else ""
                raise DatasetError(
                    f"{self._dataset.path}: {found.name} is {found.here} in this episode, but {found.there} in "
                    f"{found.where}; record into a new dataset, or say that it varies between "
                    f"episodes (varies=[{found.name.removeprefix(RATES).removeprefix(DECLARED)!r}]){kept}"
                )
            self._write(setup)
        self._setup = setup

    def _living(self) -> Iterator[tuple[str, Setup]]:
        """Yield name and setup of the other writers that are running, and remove the setup files of dead writers."""
        for file in sorted(self._file.parent.glob(f"*{SETUP}")):
            if file == self._file:
                continue
            journal = file.with_suffix(JOURNAL)
            descriptor = take_over(journal)
            if descriptor is not None:
                os.close(descriptor)
            if descriptor is not None or not journal.exists():
                file.unlink(missing_ok=True)
                continue
            yield f"{file.stem}, which is being recorded", parse_as(read_side_file(file), Setup, file)

    def _write(self, setup: Setup) -> None:
        try:  # no sync or rename: the file is read under the same lock, and is not valid once its writer is dead
            descriptor = open_regular(self._file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            with os.fdopen(descriptor, "wb") as file:
                file.write(msgspec.json.encode(setup))
        except OSError as error:
            raise StorageError(f"cannot write {self._file}: {error.strerror}") from error


def check_agreement(dataset: Dataset, episodes: Sequence[int], cameras: Collection[str] | None = None) -> None:
    """Check that episodes that are to be used together were recorded with the same setup.

    Args:
        dataset: Dataset that holds the episodes.
        episodes: Indices of the episodes.
        cameras: Names of the cameras that will be used. None means all cameras.

    Raises:
        DatasetError: If two episodes differ in a fact that neither the dataset nor an episode declares to vary.
        FormatError: If an episode is damaged.
    """
    wanted = set(episodes)
    found = [entry for entry in entries(dataset) if entry.index in wanted]
    for entry in found:
        if entry.error:
            raise FormatError(entry.error)
    setups = [(str(dataset.path / entry.name), entry.setup) for entry in found]
    refuse_difference(
        first_difference(setups, Common(dataset.varies, cameras)),
        "use these episodes together",
        "if that is meant, copy them with svfl-data merge DATASET NEW --varies {name}",
    )
