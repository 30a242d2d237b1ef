"""Archives of stored members: what they may claim is bounded by the file, and nothing in a replay file is unpickled."""

import io
import json
import os
import pickle
import struct
import zipfile

import numpy as np
import pytest

from svfl_data.errors import FormatError
from svfl_data.replay import ReplayBuffer
from svfl_data.system.stored_zip import Stored, stored
from tests.helpers.replay_episodes import agent_buffer


def archive(**members):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, data in members.items():
            file.writestr(name, data)
    return buffer.getvalue()


def refusal(content):
    with pytest.raises(zipfile.BadZipFile) as caught:
        Stored(io.BytesIO(content))
    return str(caught.value)


def test_what_is_stored_is_read(tmp_path):
    (tmp_path / "a.zip").write_bytes(archive(one=b"1", two=b"22"))
    (tmp_path / "link.zip").symlink_to("a.zip")
    for name in ("a.zip", "link.zip"):
        with stored(tmp_path / name) as found:
            assert found.members == {"one": 1, "two": 2}
            assert found.read("two") == b"22"
            with pytest.raises(KeyError):
                found.read("three")


def test_bombs_are_refused():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("zeros", bytes(10**7))
    assert "zeros is compressed" in refusal(packed.getvalue())

    whole = archive(aaaa=bytes(1000), bbbb=bytes(1000))  # two names for the same bytes
    directory = whole.rfind(b"PK\x01\x02")
    offset = struct.unpack_from("<I", whole, whole.find(b"PK\x01\x02") + 42)
    twins = bytearray(whole)
    struct.pack_into("<I", twins, directory + 42, *offset)
    struct.pack_into("<II", twins, directory + 20, 1500, 1500)
    assert "together are larger than the file" in refusal(bytes(twins))


@pytest.mark.parametrize("name", ["../up", "/etc/passwd", "a/../../b", "..\\up", "a/.."])
def test_names_that_lead_elsewhere_are_refused(name):
    assert "is not allowed as the name of a member" in refusal(archive(**{name: b""}))


def test_bytes_before_the_archive_are_refused():
    assert "does not begin" in refusal(pickle.dumps(print) + archive(one=b"1"))
    assert "does not begin" in refusal(b"")


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_only_ordinary_files_are_opened(tmp_path, make):
    make(tmp_path / "x")
    with pytest.raises((FormatError, IsADirectoryError)), stored(tmp_path / "x"):
        pass


class Payload:
    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)


def objects(marker):
    """An array of objects as NumPy writes it: its data is a pickle."""
    content = io.BytesIO()
    np.lib.format.write_array(content, np.array([Payload(marker)], object), allow_pickle=True)
    return content.getvalue()


def lying(shape):
    """An array that is declared larger than it is."""
    content = io.BytesIO()
    np.lib.format.write_array_header_1_0(content, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return content.getvalue()


@pytest.mark.parametrize("kind", ["objects", "pickle", "large", "vast"])
def test_a_replay_file_never_runs_anything(tmp_path, kind):
    file, marker = tmp_path / "b.replay", tmp_path / "the payload ran"
    agent_buffer(4, capacity=12).save(file)
    with zipfile.ZipFile(file) as whole:
        good = {name: whole.read(name) for name in whole.namelist()}
    contents = {
        "objects": objects(marker), "pickle": pickle.dumps(Payload(marker)), "large": lying((10**11,)),
        "vast": lying((2**60, 2**60)),
    }  # fmt: skip
    for name in good:
        file.write_bytes(archive(**good | {name: contents[kind]}))
        with pytest.raises(FormatError) as caught:
            ReplayBuffer.load(file)
        assert "\n" not in str(caught.value)
        assert not marker.exists()


def test_what_a_replay_file_says_reaches_no_terminal_as_it_is(tmp_path):
    for header in ({"format": "\x1b[2J\n"}, {"format": "svfl-replay", "format_version": "\x1b[2J\n9"}):
        (tmp_path / "b.replay").write_bytes(archive(**{"replay.json": json.dumps(header)}))
        with pytest.raises(FormatError) as caught:
            ReplayBuffer.load(tmp_path / "b.replay")
        assert str(caught.value).isprintable()
