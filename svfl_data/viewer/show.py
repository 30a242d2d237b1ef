"""Functions that show episodes in the viewer's window or in a browser, or save them in a file for the viewer."""

import errno
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import rerun as rr

from svfl_data.errors import SvflError
from svfl_data.system.atomic_io import named_aside
from svfl_data.system.printable import printable, say
from svfl_data.viewer import blueprint
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_data.viewer.entities.names import APPLICATION
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.recording import log_episode

LOOPBACK = "127.0.0.1"
FOOTER, FOOTER_WITHIN = b"RRF2FOOT", 64
"""Mark in the footer of a complete Rerun recording, and the number of last bytes of the file that contain the mark."""


class ViewerError(SvflError):
    """Error that is raised if the viewer or its server cannot be started on this machine, or fails."""


Content = Callable[[rr.RecordingStream], None]
"""Function that logs the content to be shown, and the layout of the window, to a recording."""


def content(episodes: Sequence[tuple[EpisodeSource, Prediction | None]], urdf: Path | None = None) -> Content:
    """Prepare episodes to be shown.

    Args:
        episodes: One episode, or several episodes with different roots, which are shown side by side; each with the
            prediction of a network, or None.
        urdf: URDF of the arm. None for the Panda of the simulation.

    Returns:
        Function that logs the episodes and the layout of the window to a recording.
    """

    def log(recording: rr.RecordingStream) -> None:
        metas = [shown.meta for shown, _ in episodes]
        recording.send_recording_name(printable(f"{metas[0].task} {', '.join(str(meta.index) for meta in metas)}"))
        pages = [(shown, log_episode(recording, shown, prediction, urdf), prediction) for shown, prediction in episodes]
        recording.send_blueprint(blueprint.one(*pages[0]) if len(pages) == 1 else blueprint.side_by_side(pages))

    return log


def save(shown: Content, path: Path) -> None:
    """Write a recording file that Rerun opens; no partial file is left if writing fails.

    Args:
        shown: Content of the recording.
        path: The ``.rrd`` file to write; replaced if it exists.

    Raises:
        StorageError: If the file cannot be written. A file that existed before is then unchanged.
    """
    with named_aside(path) as part:
        with _silent():
            _record(shown, part)
        _check_written(part)


def _record(shown: Content, part: Path) -> None:
    """Write a recording to an empty file.

    Raises:
        OSError: If Rerun's writer failed. It does not always report the reason; the usual reason is a full disk.
    """
    recording = rr.RecordingStream(APPLICATION)
    try:
        recording.save(os.fsencode(part).decode("utf-8", "surrogateescape"))  # Rerun supports no other encoding
        shown(recording)
        recording.flush()
    except RuntimeError as error:
        if "writ" not in str(error):
            raise
        told = re.search(r"os error (\d+)", str(error))
        number = int(told[1]) if told else errno.ENOSPC
        raise OSError(number, os.strerror(number)) from error
    finally:
        with suppress(RuntimeError):
            recording.disconnect()


@contextmanager
def _silent() -> Iterator[None]:
    """Discard all output on standard error, because Rerun's threads write messages there if the disk is full."""
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed already
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _check_written(part: Path) -> None:
    """Wait until a recording is on the disk, and check its end, because Rerun's writer only warns of a full disk.

    Raises:
        OSError: If the end of the recording is missing.
    """
    with part.open("rb+") as file:
        os.fsync(file.fileno())
        file.seek(-min(FOOTER_WITHIN, file.seek(0, os.SEEK_END)), os.SEEK_END)
        if FOOTER not in file.read():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def command_to_open(path: Path) -> str:
    """Return a shell command that opens a recording from the current folder, even in an inactive environment.

    Args:
        path: File of the recording.
    """
    program = Path(sys.executable).parent / "rerun"
    if shutil.which("rerun") == str(program):
        return shlex.join(["rerun", str(path)])
    return shlex.join([os.path.relpath(program), str(path)])


def show(shown: Content) -> None:
    """Open Rerun's viewer and wait until its window is closed.

    The viewer's server for live data listens only on the loopback address of this machine.

    Args:
        shown: Content to show.

    Raises:
        StorageError: If the temporary recording cannot be written.
        ViewerError: If there is no display, or the viewer fails.
    """
    if sys.platform == "linux" and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise ViewerError(
            "there is no display to open the viewer on; write a file instead with --out FILE.rrd, or show it in a "
            "browser with --web"
        )
    with tempfile.TemporaryDirectory(prefix="svfl-view-") as folder:
        file = Path(folder) / "episode.rrd"
        save(shown, file)
        _run(["--new", "--bind", LOOPBACK, str(file)], "write a file instead with --out FILE.rrd")


def serve(shown: Content, bind: str = LOOPBACK, port: int = 9090) -> None:
    """Serve the viewer to browsers until interrupted.

    Args:
        shown: Content to show.
        bind: Address to listen on. By default only browsers on this machine can connect.
        port: Port of the page. The data are served on the next port.

    Raises:
        StorageError: If the temporary recording cannot be written.
        ViewerError: If the server fails, such as because a port is in use.
    """
    with tempfile.TemporaryDirectory(prefix="svfl-view-") as folder:
        file = Path(folder) / "episode.rrd"
        save(shown, file)
        say(f"{web_address(bind, port)} (Ctrl-C ends it)")
        if bind not in (LOOPBACK, "localhost", "::1"):
            say(f"{bind}: whoever reaches this machine sees these data, and can change what is shown")
        ports = ["--web-viewer-port", str(port), "--port", str(port + 1)]
        _run(["--serve-web", "--bind", bind, *ports, str(file)], "choose another one with --port")


def web_address(bind: str, port: int) -> str:
    """Return the address of the page that a browser must open.

    Args:
        bind: Address that the server listens on. For all addresses (``0.0.0.0``, ``::``), the loopback address is used.
        port: Port of the page. The data are served on the next port.
    """
    host = LOOPBACK if bind in ("0.0.0.0", "::") else bind
    data = f"rerun%2Bhttp%3A%2F%2F{host}%3A{port + 1}%2Fproxy"
    return f"http://{host}:{port}/?url={data}"


def _run(arguments: list[str], advice: str) -> None:
    command = [sys.executable, "-P", "-m", "rerun", *arguments]
    # Rerun's Python program starts the viewer as a child process; one process group lets both be ended together.
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as viewer:
        try:
            said = _until_it_ends(viewer)
        except BaseException:
            with suppress(ProcessLookupError):
                os.killpg(viewer.pid, signal.SIGKILL)
            raise
    if viewer.returncode:
        reason = (said.strip().splitlines() or ["no reason given"])[-1]
        raise ViewerError(f"the viewer failed ({reason}); {advice}")


def _until_it_ends(viewer: "subprocess.Popen[str]") -> str:
    """Wait until the viewer ends, and return its output on standard error.

    Python checks for signals before it waits, and a signal that arrives just after the check does not interrupt the
    wait. Therefore the wait is repeated every second.
    """
    while True:
        with suppress(subprocess.TimeoutExpired):
            return viewer.communicate(timeout=1.0)[1]
