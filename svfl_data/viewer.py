"""Showing an episode to a person: Rerun's viewer, or a file that it opens."""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from svfl_data.episode import Episode
from svfl_data.errors import SvflError
from svfl_data.recording import recording_bytes
from svfl_data.store import write_atomically


class ViewerError(SvflError):
    """The viewer's window cannot be opened on this machine."""


def save(episode: Episode, path: Path) -> None:
    """Write an episode as a recording that Rerun opens, whole or not at all.

    Args:
        episode: What to show.
        path: The ``.rrd`` file; replaced if it exists.

    Raises:
        StorageError: If the disk refuses; a file that was there before is untouched.
    """
    write_atomically(path, recording_bytes(episode))


def command_to_open(path: Path) -> str:
    """The command that opens a recording, as it works from here, whether or not the environment is activated."""
    program = Path(sys.executable).parent / "rerun"
    if shutil.which("rerun") == str(program):
        return shlex.join(["rerun", str(path)])
    return shlex.join([os.path.relpath(program), str(path)])


def show(episode: Episode) -> None:
    """Open an episode in Rerun's viewer and wait until its window is closed.

    The viewer's server for live data listens on this machine only.

    Args:
        episode: What to show.

    Raises:
        ViewerError: If there is no display, or the viewer fails.
    """
    if sys.platform == "linux" and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise ViewerError("there is no display to open the viewer on; write a file instead with --save FILE.rrd")
    with tempfile.TemporaryDirectory(prefix="svfl-view-") as folder:
        file = Path(folder) / "episode.rrd"
        file.write_bytes(recording_bytes(episode))
        command = [sys.executable, "-P", "-m", "rerun", "--new", "--bind", "127.0.0.1", str(file)]
        viewer = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    if viewer.returncode:
        reason = (viewer.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise ViewerError(f"the viewer failed ({reason}); write a file instead with --save FILE.rrd")
