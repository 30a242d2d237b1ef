"""Episodes in a file, in the viewer's window, or in a browser."""

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
from svfl_data.viewer.episode_source import EpisodeSource
from svfl_data.viewer.names import APPLICATION
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.recording import log_episode

LOOPBACK = "127.0.0.1"
FOOTER, FOOTER_WITHIN = b"RRF2FOOT", 64
"""How a whole recording ends: this within its last bytes."""


class ViewerError(SvflError):
    """The viewer's window cannot be opened on this machine."""


Content = Callable[[rr.RecordingStream], None]
"""Logs what is to be shown, and the arrangement of the window."""


def content(episodes: Sequence[tuple[EpisodeSource, Prediction | None]], urdf: Path | None = None) -> Content:
    """Episodes as something to show.

    Args:
        episodes: One, or several with a root each, to be shown side by side; each with what a network says of it.
        urdf: Description of the arm; that of the Panda if not given.
    """

    def log(recording: rr.RecordingStream) -> None:
        metas = [shown.meta for shown, _ in episodes]
        recording.send_recording_name(printable(f"{metas[0].task} {', '.join(str(meta.index) for meta in metas)}"))
        pages = [(shown, log_episode(recording, shown, prediction, urdf), prediction) for shown, prediction in episodes]
        recording.send_blueprint(blueprint.one(*pages[0]) if len(pages) == 1 else blueprint.side_by_side(pages))

    return log


def save(shown: Content, path: Path) -> None:
    """Write a recording that Rerun opens, whole or not at all.

    Args:
        shown: What to show.
        path: The ``.rrd`` file; replaced if it exists.

    Raises:
        StorageError: If the disk refuses; a file that was there before is untouched.
    """
    with named_aside(path) as part:
        with _silent():
            _record(shown, part)
        _check_written(part)


def _record(shown: Content, part: Path) -> None:
    """Write a recording to an empty file.

    Raises:
        OSError: If Rerun's writer has given up. It does not always tell why; the usual reason is a full disk.
    """
    recording = rr.RecordingStream(APPLICATION)
    try:
        recording.save(os.fsencode(part).decode("utf-8", "surrogateescape"))  # Rerun knows no other encoding
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
    """Nothing on standard error: Rerun's threads write lines of their own there about a disk that is full."""
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # it is closed already
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
    """Wait until a recording is on the disk; Rerun's writer only warns when a disk is full, and leaves the end out.

    Raises:
        OSError: If it is not whole.
    """
    with part.open("rb+") as file:
        os.fsync(file.fileno())
        file.seek(-min(FOOTER_WITHIN, file.seek(0, os.SEEK_END)), os.SEEK_END)
        if FOOTER not in file.read():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def command_to_open(path: Path) -> str:
    """The command that opens a recording, as it works from here, whether or not the environment is activated."""
    program = Path(sys.executable).parent / "rerun"
    if shutil.which("rerun") == str(program):
        return shlex.join(["rerun", str(path)])
    return shlex.join([os.path.relpath(program), str(path)])


def show(shown: Content) -> None:
    """Open Rerun's viewer and wait until its window is closed.

    The viewer's server for live data listens on this machine only.

    Raises:
        ViewerError: If there is no display, or the viewer fails.
    """
    if sys.platform == "linux" and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise ViewerError(
            "there is no display to open the viewer on; write a file instead with --save FILE.rrd, or show it in a "
            "browser with --web"
        )
    with tempfile.TemporaryDirectory(prefix="svfl-view-") as folder:
        file = Path(folder) / "episode.rrd"
        save(shown, file)
        _run(["--new", "--bind", LOOPBACK, str(file)], "write a file instead with --save FILE.rrd")


def serve(shown: Content, bind: str = LOOPBACK, port: int = 9090) -> None:
    """Serve the viewer to browsers until interrupted.

    Args:
        shown: What to show.
        bind: Address to listen on; by default only this machine can look.
        port: Of the page; the data come from the next one.

    Raises:
        ViewerError: If the server fails, such as for a port in use.
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
    """The page to open."""
    host = LOOPBACK if bind in ("0.0.0.0", "::") else bind
    data = f"rerun%2Bhttp%3A%2F%2F{host}%3A{port + 1}%2Fproxy"
    return f"http://{host}:{port}/?url={data}"


def _run(arguments: list[str], advice: str) -> None:
    command = [sys.executable, "-P", "-m", "rerun", *arguments]
    # Rerun's Python program starts the viewer as a child of its own, so that both have to be ended: as one group.
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
    """What the viewer has written to standard error, once it has ended.

    Python looks for signals before it waits, and one that comes just after that does not wake it up; so it looks again
    every second.
    """
    while True:
        with suppress(subprocess.TimeoutExpired):
            return viewer.communicate(timeout=1.0)[1]
