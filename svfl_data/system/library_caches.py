"""Where the libraries that our commands use keep what they compute: in the user's cache, else in a temporary folder.

By themselves they write to several places: a folder that is missing or cannot be written costs a warning or the
command, and PyTorch's compiler uses a folder of a known name in /tmp, which another user may have made.
"""

import atexit
import os
import shutil
import tempfile
from contextlib import suppress

from svfl_data.system.cache_folder import cache_folder

FOLDERS = {"MPLCONFIGDIR": "matplotlib", "TORCHINDUCTOR_CACHE_DIR": "torchinductor", "TRITON_CACHE_DIR": "triton"}
"""Environment variable that names a library's folder, and its name in the cache."""


def confine_caches() -> None:
    """Name these folders, for this process and those it starts; what the user has named stays."""
    for variable, purpose in FOLDERS.items():
        if variable not in os.environ:
            with suppress(OSError):  # nothing can be written anywhere; each library says what it then cannot do
                os.environ[variable] = str(cache_folder(purpose) or _temporary(purpose))


def _temporary(purpose: str) -> str:
    """A folder for as long as this process lives."""
    folder = tempfile.mkdtemp(prefix=f"svfl-{purpose}-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
