"""A disk that fills up: one that is really small, where root may mount one, and one that refuses writes, for all."""

import errno
import os
import subprocess

import pytest

FILLER = "filler"


class Disk:
    """A folder on a disk that can be filled and emptied again."""

    def __init__(self, folder, fill, empty):
        self.folder, self.fill, self.empty = folder, fill, empty


@pytest.fixture(params=["mounted", "refusing"])
def disk(request, tmp_path, monkeypatch):
    folder = tmp_path / "small"
    folder.mkdir()
    if request.param == "refusing":
        real = os.fsync
        yield Disk(
            folder, lambda: monkeypatch.setattr(os, "fsync", refuse), lambda: monkeypatch.setattr(os, "fsync", real)
        )
        return
    mount = ["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", folder]
    if os.geteuid() or subprocess.run(mount, stderr=subprocess.DEVNULL).returncode:
        pytest.skip("mounting a small file system is not permitted here")
    try:
        monkeypatch.setenv("TMPDIR", str(tmp_path))  # another file system, with room
        yield Disk(folder, lambda: fill(folder), lambda: (folder / FILLER).unlink())
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)


def refuse(_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fill(folder):
    with (folder / FILLER).open("wb", buffering=0) as file:
        for size in (65536, 4096, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue
