"""Where escnn keeps on disk what it has computed: in the user's cache instead of its own package.

escnn 1.0.11 keeps tables of its groups (tens of CPU seconds to compute) with joblib, in a folder inside the installed
package; where that is read-only, as for a system-wide installation, importing escnn fails. The tables hold for every
project of the user.
"""

import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path

import joblib


@contextmanager
def kept_by_the_user() -> Iterator[None]:
    """Import escnn in here: it then keeps its tables in `cache_folder`."""
    memory = joblib.Memory
    joblib.Memory = lambda _, **options: memory(cache_folder(), **options)
    try:
        yield
    finally:
        joblib.Memory = memory


@cache
def cache_folder() -> str | None:
    """A folder that can be written: the user's; else one for as long as this process lives; else none."""
    folders = (user_folder, temporary_folder)
    return next((str(path) for path in (folder() for folder in folders) if path is not None and writable(path)), None)


def user_folder() -> Path | None:
    """``svfl/escnn-VERSION`` in ``$XDG_CACHE_HOME`` or ``~/.cache``; none without a home or a version."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:  # a relative XDG_CACHE_HOME is to be ignored (XDG Base Directory Specification 0.8)
        caches = named if named.is_absolute() else Path.home() / ".cache"
        return caches / "svfl" / f"escnn-{metadata.version('escnn')}"
    except (RuntimeError, metadata.PackageNotFoundError):
        return None


def temporary_folder() -> Path | None:
    """A folder of this process's own: joblib unpickles what it finds, so no shared one of a known name."""
    try:
        folder = tempfile.mkdtemp(prefix="svfl-escnn-")
    except OSError:
        return None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is created if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
