"""Bringing a dataset back in order after kills, power cuts and damage: what can be saved is, nothing is deleted.

Journals of writers that are gone become episodes; damaged files move to ``damaged/``. Writers that live are left alone,
and running it twice changes nothing more.
"""

import filecmp
import multiprocessing
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from svfl_data.atomically import write_atomically
from svfl_data.claims import INFLIGHT, PART, SETUP, build, claim, inflight, locked, publish, take_over
from svfl_data.dataset import Dataset, inner_folder
from svfl_data.episode import Meta
from svfl_data.errors import FormatError, SvflError
from svfl_data.fields import CAMERA, FIELDS, camera_names, check_arrays
from svfl_data.growth import grows
from svfl_data.journal import SUFFIX, Journal, read_journal
from svfl_data.regular_file import refuse_link
from svfl_data.seal import check_seal, has_seal
from svfl_data.store import Rows, read_unsealed, resealed_bytes

DAMAGED = "damaged"
READ_SECONDS = 60.0
"""Time to read a file whose seal is gone, in a process of its own: HDF5 may keep trying a damaged one for ever."""


@dataclass(frozen=True)
class RepairAction:
    """One thing that was found and what was done about it.

    Attributes:
        path: The file that matters now.
        done: ``published`` (a whole episode that lacked only its name), ``salvaged`` (an unfinished episode, up to the
            last flush), ``resealed``, ``quarantined`` (moved to ``damaged/``), ``cleared`` (remains of a step that was
            finished already) or ``in use`` (its writer lives, nothing was done).
        detail: In words, for a person.
        saved: Whether readings became usable by it.
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
        path: The dataset's folder.
        reseal: Whether files that lost their seal to other software are sealed again, if what they hold is a valid
            episode; otherwise they are set aside like damaged ones.

    Returns:
        What was found and done; empty if everything was in order.

    Raises:
        FormatError: If the folder is not a dataset.
        StorageError: If the disk refuses; what was done before stays done, and repairing again goes on.
    """
    dataset = Dataset.open(path)
    actions: list[RepairAction] = []
    refuse_link(dataset.path / INFLIGHT)
    if (dataset.path / INFLIGHT).is_dir():
        for journal in sorted((dataset.path / INFLIGHT).glob(f"*{SUFFIX}")):
            actions += _finish(dataset, journal)
    for index, file in sorted(dataset.own_files().items()):
        actions += _check_file(dataset, index, file, reseal)
    return actions


def repair_exit_code(actions: list[RepairAction]) -> int:
    """How a repair went, as a process says it: 0 all saved, 3 some readings lost, 1 nothing could be saved."""
    if not any(action.lost for action in actions):
        return 0
    return 3 if any(action.saved for action in actions) else 1


def _finish(dataset: Dataset, path: Path) -> list[RepairAction]:
    """Make an episode of a journal, if its writer is gone."""
    descriptor = take_over(path)
    if descriptor is None:
        return [RepairAction(path, "in use", "is being written")] if path.exists() else []
    try:
        journal = read_journal(descriptor)
        if journal.meta is None:
            return [_set_aside(dataset, path, "not even its first record is intact")]
        arrays = _salvage(journal)
        try:
            check_arrays({name: _shaped(array) for name, array in arrays.items()}, str(path))
        except SvflError as error:
            return [_set_aside(dataset, path, f"too little was recorded for an episode ({error})")]
        action = _publish(dataset, _meta(journal, arrays), arrays)
        path.unlink()
        path.with_suffix(PART).unlink(missing_ok=True)
        return [action]
    finally:
        path.with_suffix(SETUP).unlink(missing_ok=True)
        os.close(descriptor)


def _salvage(journal: Journal) -> dict[str, Rows]:
    """The arrays; of an unfinished episode, each group is cut to the rows that all its streams have."""
    if journal.end is not None:
        return {**journal.constants, **journal.streams}
    rows: dict[str, int] = {}
    for path, stream in journal.streams.items():
        group = path.rpartition("/")[0]
        rows[group] = min(rows.get(group, stream.rows), stream.rows)
    if "observations" in rows and "actions" in rows:
        rows["actions"] = min(rows["actions"], rows["observations"] - 1)
        rows["observations"] = rows["actions"] + 1
    elif "observations" in rows:
        rows["observations"] = 1
    streams: dict[str, Rows] = {
        path: stream.first(max(0, rows[path.rpartition("/")[0]])) for path, stream in journal.streams.items()
    }
    for field in FIELDS:  # what had not begun yet has no rows
        if grows(field) and not field.optional and CAMERA not in field.path and field.path not in streams:
            sizes = [size for size in field.shape[1:] if isinstance(size, int)]
            streams[field.path] = np.zeros((0, *sizes), field.dtype)
    frames = [f"cameras/{camera}/" for camera in camera_names(streams)]
    for path, array in journal.constants.items():
        if not path.startswith("cameras/") or path.startswith(tuple(frames)):
            streams[path] = array
    return streams


def _meta(journal: Journal, arrays: Mapping[str, Rows]) -> Meta:
    if journal.end is not None:
        return Meta(**journal.end)
    meta = Meta(**(journal.meta or {}))
    rows = {path: array.shape[0] for path, array in arrays.items() if path in journal.streams}
    entry = {"tool": "repair", "salvaged": True, "rows": rows, "damaged_bytes": journal.size - journal.intact}
    return replace(meta, success=False, history=[*meta.history, entry])


def _publish(dataset: Dataset, meta: Meta, arrays: Mapping[str, Rows]) -> RepairAction:
    path = dataset.episode_path(meta.index)
    salvaged = any(entry.get("salvaged") for entry in meta.history)
    part = build(dataset, meta, arrays)
    try:
        check_seal(part)
        publish(part, path)
    except FileExistsError:
        if filecmp.cmp(part, path, shallow=False):
            part.unlink()
            return RepairAction(path, "cleared", "had been published already", saved=True, lost=salvaged)
        part.unlink()
        index, descriptor, journal = claim(dataset)  # the index went to another episode: take the next one
        try:
            return _publish(dataset, replace(meta, index=index), arrays)
        finally:
            journal.unlink()
            os.close(descriptor)
    steps = arrays["actions/action"].shape[0]
    if salvaged:
        return RepairAction(path, "salvaged", f"{steps} steps up to the writer's last flush", saved=True, lost=True)
    return RepairAction(path, "published", f"all {steps} steps", saved=True)


def _check_file(dataset: Dataset, index: int, path: Path, reseal: bool) -> list[RepairAction]:
    """Set a damaged episode aside."""
    try:
        check_seal(path)
        return []
    except FormatError as error:
        why = str(error).removeprefix(f"{path}: ")
    if not reseal or has_seal(path):
        return [_set_aside(dataset, path, why)]
    if _in_time(path):
        content = path.read_bytes()
        write_atomically(path, resealed_bytes(content, {"tool": "repair", "resealed": True}))
        check_seal(path)
        return [RepairAction(path, "resealed", f"holds a valid episode {index}", saved=True)]
    return [_set_aside(dataset, path, f"{why}; what it holds is not a valid episode")]


def _in_time(path: Path) -> bool:
    """Whether an unsealed file holds a valid episode; HDF5 may crash or hang on it, so another process looks."""
    process = multiprocessing.get_context("fork").Process(target=_read, args=(path,), daemon=True)
    process.start()
    process.join(READ_SECONDS)
    if process.is_alive():
        process.kill()
        process.join()
    return process.exitcode == 0


def _read(path: Path) -> None:
    try:
        read_unsealed(path)
    except SvflError as error:
        raise SystemExit(1) from error


def _set_aside(dataset: Dataset, path: Path, why: str) -> RepairAction:
    """Move a file to ``damaged/``, never over another one."""
    folder = inner_folder(dataset.path, DAMAGED)
    with locked(inflight(dataset.path)):
        copies = [path.name, *(f"{path.stem}.{number}{path.suffix}" for number in range(1, 10_000))]
        target = next(folder / name for name in copies if not (folder / name).exists())
        os.rename(path, target)
    return RepairAction(target, "quarantined", f"{path.name}: {why}", lost=True)


def _shaped(array: Rows) -> np.ndarray:
    """Stands for an array where only dtype and shape matter."""
    return array if isinstance(array, np.ndarray) else np.broadcast_to(np.zeros((), array.dtype), array.shape)
