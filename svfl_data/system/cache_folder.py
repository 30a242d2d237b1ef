"""The one place outside its outputs where this software keeps anything: a folder of the user's own, or none.

Everything in it can be computed again. It is used only if nobody else can write there, so that what is read back from
it was written by this user.
"""

import functools
import hashlib
import os
import stat
from pathlib import Path

VARIABLE = "SVFL_CACHE_DIR"


def cache_folder(purpose: str) -> Path | None:
    """The folder in which one part of the software keeps what it has computed; made if it does not exist.

    It is the subfolder `purpose` of ``$SVFL_CACHE_DIR``, or else of ``svfl`` in ``$XDG_CACHE_HOME`` or ``~/.cache``.

    Args:
        purpose: Name of the subfolder, such as ``numba``.

    Returns:
        The folder, which belongs to this user and which nobody else can write to; None if there is no such place
        (no home folder, a read-only disk, a folder of another user), and then nothing is kept.
    """
    root = _root()
    if root is None:
        return None
    folder = root / purpose
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if _is_own(root) and _is_own(folder) else None


def _root() -> Path | None:
    if named := os.environ.get(VARIABLE):
        return Path(named) if Path(named).is_absolute() else None
    caches = Path(os.environ.get("XDG_CACHE_HOME", ""))  # relative paths are to be ignored, says its specification
    try:
        return (caches if caches.is_absolute() else Path.home() / ".cache") / "svfl"
    except RuntimeError:  # no home folder
        return None


def _is_own(folder: Path) -> bool:
    """Whether a path is a folder, no link, of this user, and only this user can write to it."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    own = found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(found.st_mode) and own and os.access(folder, os.W_OK | os.X_OK)


@functools.cache
def source_hash(*names: str) -> str:
    """SHA-256 of source code that a kept result depends on: another version may come to another one.

    Args:
        names: Files and folders of ``svfl_data``, such as ``checks`` or ``symmetry.py``.
    """
    package, digest = Path(__file__).parents[1], hashlib.sha256()
    for name in names:
        path = package / name
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()
