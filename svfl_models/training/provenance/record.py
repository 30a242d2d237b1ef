"""The sessions of a run, oldest first, in its folder, in its checkpoint and in what is exported from that.

A run has several sessions if it was interrupted and went on. They are not part of its configuration: a run goes on
under another commit or on another machine. What is read may come from anybody: it is limited in size, and of declared
types; whoever shows it makes its texts printable (`words`).
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from svfl_data.errors import FormatError
from svfl_data.system.printable import printable
from svfl_data.system.side_files import check_format, parse_json, read_json
from svfl_models.training.provenance.session import MOST, Session
from svfl_models.training.run_folder import PROVENANCE
from svfl_models.training.writing import write_json

FORMAT = "svfl-provenance"
FORMAT_VERSION = "1.0"
KEY = "svfl_provenance"
"""Key of a checkpoint that holds the sessions, beside its mark."""
TEXT = "svfl_provenance.json"
"""Name of the text inside an exported program that holds the sessions."""
Sessions = Annotated[list[Session], msgspec.Meta(max_length=MOST)]


def record(out: Path, session: Session) -> list[Session]:
    """Add a session to those of a run or an experiment, in its folder.

    Args:
        out: Folder of the run, locked by this process.
        session: The session that begins.

    Returns:
        All sessions, oldest first. Of more than `MOST` the first and the latest are kept.

    Raises:
        FormatError: If the file of the earlier sessions is damaged.
        StorageError: If the file cannot be written.
    """
    sessions = [*recorded(out), session]
    if len(sessions) > MOST:
        sessions = [sessions[0], *sessions[1 - MOST :]]
    write_json(out / PROVENANCE, _content(sessions))
    return sessions


def recorded(out: Path) -> list[Session]:
    """Return the sessions of a run or an experiment; none if its folder does not tell.

    Args:
        out: Folder of the run or the experiment.

    Raises:
        FormatError: If the file in the folder does not hold sessions.
    """
    path = out / PROVENANCE
    try:
        found = read_json(path)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    return _of_content(found, path)


def of_runs(folders: Iterable[Path]) -> list[list[Session]]:
    """Return the sessions of each of several runs; none for a run whose folder does not tell, or holds something else.

    Args:
        folders: Folders of the runs.
    """
    found: list[list[Session]] = []
    for folder in folders:
        try:
            found.append(recorded(folder))
        except FormatError:
            found.append([])
    return found


def of_checkpoint(found: Mapping[str, Any], where: object) -> list[Session]:
    """Return the sessions that a checkpoint holds; none if it is from before there were any.

    Args:
        found: Content of the checkpoint, as `checkpoint_io.read` returns it.
        where: Name of the checkpoint for the message.

    Raises:
        FormatError: If the checkpoint holds something else in their place.
    """
    return _converted(found.get(KEY, []), where)


def as_text(sessions: Sequence[Session]) -> str:
    """Return sessions as the text that goes into an exported program."""
    return json.dumps(_content(sessions))


def of_text(text: str, where: object) -> list[Session]:
    """Return the sessions that an exported program holds as a text.

    Raises:
        FormatError: If the text does not hold sessions.
    """
    return _of_content(parse_json(text, where), where)


def plain(sessions: Sequence[Session]) -> list[dict[str, Any]]:
    """Return sessions as plain values, for checkpoints and files."""
    return [one.plain() for one in sessions]


def _content(sessions: Sequence[Session]) -> dict[str, Any]:
    return {"format": FORMAT, "format_version": FORMAT_VERSION, "sessions": plain(sessions)}


def _of_content(found: Any, where: object) -> list[Session]:  # noqa: ANN401 - any JSON value
    check_format(found, FORMAT, FORMAT_VERSION, where, "not the provenance of a run")
    return _converted(found.get("sessions"), where)


def _converted(value: object, where: object) -> list[Session]:
    try:
        return msgspec.convert(value, Sessions)
    except (msgspec.ValidationError, RecursionError) as error:
        raise FormatError(f"{where}: its provenance cannot be read ({printable(error, 200)})") from error
