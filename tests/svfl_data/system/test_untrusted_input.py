"""The small functions that stand between a stranger's file and the user: opening, printing, keeping."""

import os
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from svfl_data.errors import FormatError
from svfl_data.system.cache_folder import cache_folder
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import open_regular, read_regular


def test_a_link_is_neither_read_nor_written_through(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("mine")
    (tmp_path / "link").symlink_to(secret)
    for flags in (os.O_RDONLY, os.O_WRONLY | os.O_APPEND | os.O_CREAT, os.O_WRONLY | os.O_TRUNC):
        with pytest.raises(FormatError, match=f"{tmp_path / 'link'}.*symbolic link"):
            open_regular(tmp_path / "link", flags)
    assert secret.read_text() == "mine"


@pytest.mark.parametrize(("kind", "found"), [("pipe", "named pipe"), ("folder", "folder"), ("device", "device")])
def test_what_is_no_ordinary_file_is_refused_at_once(tmp_path, kind, found):
    path = tmp_path / "thing"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path = type(path)(os.devnull)
    with pytest.raises(FormatError, match=f"{path}.*{found}"):
        open_regular(path)


def test_no_more_is_read_than_allowed(tmp_path):
    (tmp_path / "file").write_bytes(bytes(10))
    assert read_regular(tmp_path / "file", 10) == bytes(10)
    with pytest.raises(FormatError, match=rf"{tmp_path / 'file'}.*\b9 bytes"):
        read_regular(tmp_path / "file", 9)


@given(st.text(st.characters(codec=None), max_size=600))
def test_printable_text_is_one_line_without_anything_invisible(text):
    shown = printable(text)
    assert len(shown.splitlines()) <= 1
    assert all(unicodedata.category(c) not in ("Cc", "Cf", "Cs", "Zl", "Zp") for c in shown)
    shown.encode("utf-8")


def test_ordinary_text_stays_as_it_is_and_long_text_is_cut():
    assert printable("Möbius-Würfel 7 µm 中文 a\\b") == "Möbius-Würfel 7 µm 中文 a\\b"
    assert printable("x\x1b[31my\nz\u202e") == "x\\x1b[31my\\nz\\u202e"
    assert len(printable("a" * 10**6, limit=100)) == 100


def test_the_cache_is_where_the_user_says_or_nowhere(tmp_path, monkeypatch):
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "mine"))
    folder = cache_folder("numba")
    assert folder == tmp_path / "mine" / "numba"
    assert folder.is_dir()
    folder.chmod(0o777)
    assert cache_folder("numba") is None  # anybody could have put something there
    monkeypatch.setenv("SVFL_CACHE_DIR", "relative")
    assert cache_folder("numba") is None
    monkeypatch.delenv("SVFL_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert cache_folder("escnn") == tmp_path / "caches" / "svfl" / "escnn"


def test_a_cache_behind_a_link_or_in_a_file_is_none(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "file").write_text("")
    for name in ("link", "file"):
        monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / name))
        assert cache_folder("numba") is None
