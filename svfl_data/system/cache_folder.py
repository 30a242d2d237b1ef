"""The folder in which this software keeps computed results outside its outputs: one of the user's own, or none.

Everything in this folder can be computed again. The folder is used only if nobody else can write to it, so that
whatever is read back from it was written by this user.

The libraries that our commands use write to several places by themselves. A folder that is missing or cannot be written
then causes a warning or ends the command, and PyTorch's compiler uses a folder of a known name in /tmp, which another
user may have made. Therefore they are given folders in ours, or else a temporary one.
"""

import atexit
import functools
import hashlib
import os
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

VARIABLE = "SVFL_CACHE_DIR"
FOLDERS = {"MPLCONFIGDIR": "matplotlib", "TORCHINDUCTOR_CACHE_DIR": "torchinductor", "TRITON_CACHE_DIR": "triton"}
"""Name of the subfolder of our cache for a library, by the environment variable that sets the library's folder."""


def cache_folder(purpose: str) -> Path | None:
    """Return the folder in which one part of the software keeps its computed results, creating it if needed.

    The folder is the subfolder `purpose` of ``$SVFL_CACHE_DIR``, or, without that variable, of ``svfl`` in
    ``$XDG_CACHE_HOME`` or ``~/.cache``.

    Args:
        purpose: Name of the subfolder, such as ``numba``.

    Returns:
        The folder, which belongs to this user and which nobody else can write to. None if there is no such folder (no
        home folder, a relative ``$SVFL_CACHE_DIR``, a read-only disk, a folder of another user). In that case nothing
        is kept.
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
    """Return whether a path is a folder of this user, not a link, to which only this user can write."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    own = found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(found.st_mode) and own and os.access(folder, os.W_OK | os.X_OK)


@functools.cache
def source_hash(*names: str) -> str:
    """Return the SHA-256 of source code on which a kept result depends.

    A kept result is valid only for the same hash, because another version of the code may compute another result.

    Args:
        names: Files and folders of the package ``svfl_data``, such as ``checks`` or ``symmetry.py``. A folder stands
            for the ``*.py`` files directly inside it.

    Returns:
        The hash as 64 hexadecimal digits.
    """
    package, digest = Path(__file__).parents[1], hashlib.sha256()
    for name in names:
        path = package / name
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def confine_caches() -> None:
    """Set the variables of `FOLDERS` for this process and the processes that it starts.

    A variable that the user has set stays as it is.
    """
    for variable, purpose in FOLDERS.items():
        if variable not in os.environ:
            with suppress(OSError):  # nothing can be written anywhere; each library says what it then cannot do
                os.environ[variable] = str(cache_folder(purpose) or _temporary(purpose))


def _temporary(purpose: str) -> str:
    """Create a temporary folder that is removed when this process ends, and return its path."""
    folder = tempfile.mkdtemp(prefix=f"svfl-{purpose}-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
