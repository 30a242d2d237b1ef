"""Folders for the files that libraries used by our commands compute: the user's cache, else a temporary folder.

Without these folders, the libraries write to several places. A folder that is missing or cannot be written then causes
a warning or ends the command, and PyTorch's compiler uses a folder of a known name in /tmp, which another user may have
made.
"""

import atexit
import os
import shutil
import tempfile
from contextlib import suppress

from svfl_data.system.cache_folder import cache_folder

FOLDERS = {"MPLCONFIGDIR": "matplotlib", "TORCHINDUCTOR_CACHE_DIR": "torchinductor", "TRITON_CACHE_DIR": "triton"}
"""Name of the subfolder of our cache for a library, by the environment variable that sets the library's folder."""


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
