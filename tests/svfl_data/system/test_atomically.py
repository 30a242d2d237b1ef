"""Files are whole or as before, whatever the disk refuses; leftovers are told from what is being written by a lock."""

import errno
import os
import signal
import subprocess
import sys
import tempfile

import pytest

from svfl_data.errors import StorageError
from svfl_data.system import leftovers
from svfl_data.system.atomic_io import named_aside, write_atomically, written_aside
from svfl_data.system.leftovers import clear_files, clear_folders, folder_aside

REFUSALS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ESTALE, errno.EIO)
STEPS = ((tempfile, "mkstemp"), (os, "fsync"), (os, "fchmod"), (os, "replace"), (os, "write"))
HOLDER = """
import sys
from pathlib import Path
from svfl_data.system.atomic_io import written_aside
with written_aside(Path(sys.argv[1])) as file:
    file.write(b"half")
    file.flush()
    print("writing", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def writer(tmp_path):
    """A process that is writing ``file`` in the folder."""
    command = [sys.executable, "-c", HOLDER, tmp_path / "file"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "writing\n"
        yield process
        process.kill()


@pytest.mark.parametrize("refusal", REFUSALS, ids=lambda number: errno.errorcode[number])
@pytest.mark.parametrize(("owner", "step"), STEPS, ids=[step for _, step in STEPS])
def test_a_refusal_at_any_step_leaves_the_earlier_file_and_nothing_else(tmp_path, monkeypatch, owner, step, refusal):
    file = tmp_path / "file"
    write_atomically(file, b"earlier")

    def refuse(*_, **__):
        raise OSError(refusal, os.strerror(refusal))

    monkeypatch.setattr(owner, step, refuse)
    with pytest.raises(StorageError, match=f"{file}.*{os.strerror(refusal)}"):
        replaced(file)
    assert file.read_bytes() == b"earlier"
    assert os.listdir(tmp_path) == ["file"]


def replaced(file):
    with written_aside(file) as part:
        part.write(b"later")
        part.flush()
        os.write(part.fileno(), b" and more")


def test_an_error_without_a_number_is_said_in_its_own_words(tmp_path):
    with pytest.raises(StorageError, match=f"{tmp_path / 'file'}.*the writer stopped"), named_aside(tmp_path / "file"):
        raise OSError("the writer stopped")


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_ordinary_file_is_not_replaced(tmp_path, make):
    make(tmp_path / "file")
    before = os.lstat(tmp_path / "file")
    with pytest.raises(StorageError, match=f"{tmp_path / 'file'} .*no ordinary file"):
        write_atomically(tmp_path / "file", b"content")
    assert os.lstat(tmp_path / "file").st_mode == before.st_mode
    assert os.listdir(tmp_path) == ["file"]


def test_a_file_written_by_its_name_is_replaced_whole(tmp_path):
    (tmp_path / "file").write_text("earlier")
    with named_aside(tmp_path / "file") as part:
        part.write_text("later")
        assert (tmp_path / "file").read_text() == "earlier"
        assert part.parent == tmp_path
    assert (tmp_path / "file").read_text() == "later"
    assert os.listdir(tmp_path) == ["file"]


def test_what_a_living_process_writes_stays_and_arrives(tmp_path, writer):
    assert clear_files(tmp_path) == []
    writer.communicate("go on")
    assert (tmp_path / "file").read_bytes() == b"half"


def test_what_a_killed_process_was_writing_is_removed(tmp_path, writer):
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    (part,) = tmp_path.iterdir()
    (tmp_path / "other").touch()
    assert clear_files(tmp_path) == [part]
    assert os.listdir(tmp_path) == ["other"]


def test_folders_are_told_apart_by_the_same_lock(tmp_path):
    for name in (".dead.svfl-x.part", ".not_ours.part"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "episode").touch()
    with folder_aside(tmp_path / "alive") as alive:
        (alive / "episode").touch()
        assert clear_folders(tmp_path) == [tmp_path / ".dead.svfl-x.part"]
        assert (alive / "episode").exists()
    assert os.listdir(tmp_path) == [".not_ours.part"]


def test_no_link_is_followed_and_no_pipe_waited_for(tmp_path):
    (tmp_path / "precious").touch()
    (tmp_path / ".link.x.part").symlink_to(tmp_path / "precious")
    os.mkfifo(tmp_path / ".pipe.x.part")
    assert clear_files(tmp_path) == []
    assert len(os.listdir(tmp_path)) == 3


def test_without_locks_files_are_written_and_nothing_is_cleared(tmp_path, monkeypatch):
    def flock(*_):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(leftovers.fcntl, "flock", flock)
    write_atomically(tmp_path / "file", b"content")
    (tmp_path / ".file.x.part").touch()
    assert clear_files(tmp_path) == []
    assert (tmp_path / "file").read_bytes() == b"content"


def test_a_file_cleared_between_its_creation_and_its_lock_is_made_again(tmp_path, monkeypatch):
    taken, hold = [], leftovers._hold

    def late(descriptor):
        if not taken:
            taken.extend(clear_files(tmp_path))
        return hold(descriptor)

    monkeypatch.setattr(leftovers, "_hold", late)
    write_atomically(tmp_path / "file", b"content")
    assert len(taken) == 1
    assert os.listdir(tmp_path) == ["file"]
