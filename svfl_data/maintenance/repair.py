"""Repair of a dataset after kills, power cuts and damage.

Journals of writers that are gone become episodes. Damaged files are moved to ``damaged/``, never deleted. Writers that
are still running are not disturbed. A second repair changes nothing more.
"""

import filecmp
import os
from dataclasses import dataclass, replace
from pathlib import Path

from svfl_data.datasets.dataset import Dataset, inner_folder
from svfl_data.datasets.index import refuse_old
from svfl_data.errors import DatasetError, FieldError, FormatError, StorageError, SvflError
from svfl_data.recording.index_locks import INFLIGHT, PART, SETUP, build, claim, inflight, locked, publish, take_over
from svfl_data.recording.journal import SUFFIX, read_journal
from svfl_data.recording.salvage import TOOL, Salvaged, salvage
from svfl_data.schema.clocks import GAP
from svfl_data.schema.episode import Meta
from svfl_data.storage.seal import check_seal, has_seal
from svfl_data.storage.store import resealed_bytes
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import refuse_link

DAMAGED = "damaged"


@dataclass(frozen=True)
class RepairAction:
    """One thing that a repair found, and what it did about it.

    Attributes:
        path: File that matters after the repair: the episode, or the file that was moved or left alone.
        done: What was done: ``published`` (a whole episode lacked only its final name), ``salvaged`` (an unfinished
            episode was saved up to the last flush), ``resealed`` (a valid episode that had lost its seal got a new
            one), ``quarantined`` (the file was moved to ``damaged/``), ``cleared`` (the remains of a finished step were
            removed), ``in use`` (nothing was done, because the writer is running) or ``left alone`` (nothing was done,
            because the file cannot be opened).
        detail: Description in words.
        saved: Whether readings became usable by the repair.
        lost: Whether readings are missing, or a file cannot be used.
    """

    path: Path
    done: str
    detail: str
    saved: bool = False
    lost: bool = False


def repair_dataset(path: Path | str, reseal: bool = False) -> list[RepairAction]:
    """Repair a dataset.

    Args:
        path: Folder of the dataset.
        reseal: Whether to seal files again that lost their seal to other software and hold a valid episode. If False,
            such files are moved to ``damaged/`` like damaged ones.

    Returns:
        What was found and done; empty if everything was in order.

    Raises:
        FormatError: If the folder is not a dataset.
        OldVersionError: If the episodes are of version 1 of the format.
        StorageError: If the disk refuses. Everything that was repaired before stays so, and a new call continues.

    Example:
        >>> repair_dataset("data/week")
        []
    """
    dataset = Dataset.open(path)
    refuse_old(dataset)
    actions: list[RepairAction] = []
    refuse_link(dataset.path / INFLIGHT)
    if (dataset.path / INFLIGHT).is_dir():
        for journal in sorted((dataset.path / INFLIGHT).glob(f"*{SUFFIX}")):
            actions += _finish(dataset, journal)
    for index, file in sorted(dataset.own_files().items()):
        actions += _check_file(dataset, index, file, reseal)
    return actions


def repair_exit_code(actions: list[RepairAction]) -> int:
    """Return the exit code of a repair: 0 if nothing was lost, 3 if a part was lost, 1 if nothing could be saved."""
    if not any(action.lost for action in actions):
        return 0
    return 3 if any(action.saved for action in actions) else 1


def _finish(dataset: Dataset, path: Path) -> list[RepairAction]:
    """Turn a journal into an episode, if the writer of the journal is gone."""
    try:
        descriptor = take_over(path)
    except (FormatError, IsADirectoryError) as error:
        return [_set_aside(dataset, path, _words(error, path))]
    except OSError as error:  # its writer may be running
        return [RepairAction(path, "left alone", f"cannot be opened ({error.strerror})", lost=True)]
    if descriptor is None:
        return [RepairAction(path, "in use", "is being written")] if path.exists() else []
    try:
        return [_finish_journal(dataset, path, descriptor)]
    except StorageError:
        raise
    except Exception as error:  # of any kind: a journal that cannot be used must not keep others from being saved
        path.with_suffix(PART).unlink(missing_ok=True)
        return [_set_aside(dataset, path, _words(error, path))]
    finally:
        path.with_suffix(SETUP).unlink(missing_ok=True)
        os.close(descriptor)


def _finish_journal(dataset: Dataset, path: Path, descriptor: int) -> RepairAction:
    journal = read_journal(descriptor)
    try:
        saved = salvage(journal, str(path))
    except FieldError as error:
        raise FieldError(f"what was recorded is too short for an episode, or not valid in one ({error})") from error
    if saved.meta.task not in str(dataset.info["task"]).split("+"):
        raise DatasetError(f"is of task {saved.meta.task!r}, not of {dataset.info['task']!r} as the dataset")
    if path.name != f"episode_{saved.meta.index:06d}{SUFFIX}":
        raise DatasetError(f"holds episode {saved.meta.index}, which its file name does not state")
    action = _publish(dataset, saved)
    if journal.incomplete:
        aside = _set_aside(dataset, path, "kept")
        action = replace(action, detail=f"{action.detail}; the damaged journal is kept as {aside.path}")
    path.unlink(missing_ok=True)
    path.with_suffix(PART).unlink(missing_ok=True)
    return action


def _publish(dataset: Dataset, saved: Salvaged) -> RepairAction:
    meta, arrays = saved.meta, saved.arrays
    path = dataset.episode_path(meta.index)
    part = build(dataset, meta, arrays, saved.declarations)
    try:
        check_seal(part)
        publish(part, path)
    except FileExistsError:
        if filecmp.cmp(part, path, shallow=False):
            part.unlink()
            return RepairAction(path, "cleared", "had been published already", saved=True, lost=not saved.whole)
        part.unlink()
        index, descriptor, journal = claim(dataset)  # another episode has the index: take the next one
        try:
            return _publish(dataset, replace(saved, meta=replace(meta, index=index)))
        finally:
            journal.unlink()
            os.close(descriptor)
    steps = arrays["observations/t_ns"].shape[0] - 1
    if not saved.whole:
        return RepairAction(path, "salvaged", _salvaged_words(steps, meta), saved=True, lost=True)
    return RepairAction(path, "published", f"all {steps} steps", saved=True)


def _salvaged_words(steps: int, meta: Meta) -> str:
    gaps = [one for one in meta.annotations if one["name"] == GAP and one.get("by", {}).get("tool") == TOOL]
    where = ", ".join(sorted({printable(one["stream"]) for one in gaps}))
    return f"{steps} steps up to the writer's last flush" + (f", with {len(gaps)} gaps in {where}" if gaps else "")


def _words(error: Exception, path: Path) -> str:
    """Return in one line why a journal cannot be used."""
    words = str(error) if isinstance(error, SvflError) else f"not a readable journal ({error!r})"
    return printable(words.replace(f"{path}: ", ""), 500)


def _check_file(dataset: Dataset, index: int, path: Path, reseal: bool) -> list[RepairAction]:
    """Check the seal of an episode file; seal a broken file again if that is wanted and possible, or set it aside."""
    try:
        check_seal(path)
        return []
    except FormatError as error:
        why = str(error).removeprefix(f"{path}: ")
    if not reseal or has_seal(path):
        return [_set_aside(dataset, path, why)]
    try:
        content = resealed_bytes(path, {"tool": "repair", "resealed": True})
    except SvflError:
        return [_set_aside(dataset, path, f"{why}; its content is not a valid episode")]
    write_atomically(path, content)
    check_seal(path)
    return [RepairAction(path, "resealed", f"holds a valid episode {index}", saved=True)]


def _set_aside(dataset: Dataset, path: Path, why: str) -> RepairAction:
    """Move a file to ``damaged/`` under a name that no other file has."""
    folder = inner_folder(dataset.path, DAMAGED)
    with locked(inflight(dataset.path)):
        copies = [path.name, *(f"{path.stem}.{number}{path.suffix}" for number in range(1, 10_000))]
        target = next(folder / name for name in copies if not os.path.lexists(folder / name))
        os.rename(path, target)
    return RepairAction(target, "quarantined", f"{path.name}: {why}", lost=True)
