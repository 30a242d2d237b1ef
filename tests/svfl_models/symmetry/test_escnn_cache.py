import os
import pickle
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import joblib
import numpy as np
import pytest

from svfl_models.symmetry import escnn_cache

pytestmark = pytest.mark.slow

BUILD = """
import warnings
warnings.simplefilter("error", UserWarning)
import torch
from svfl_models.symmetry import planar_escnn
from svfl_models.symmetry.groups import GROUPS
from svfl_models.networks.layer_factory import layer_factory
from svfl_data.symmetry import OFFSET_PARTS
layers = layer_factory(GROUPS["D4"])
print(layers.linear(layers.hidden(1), layers.vector(OFFSET_PARTS))(torch.ones(1, 8)).shape[1])
"""


@pytest.fixture
def sealed(tmp_path):
    """An installation of escnn whose cache cannot be made: a file is in its place. (To root nothing is read-only.)"""
    package = tmp_path / "site-packages" / "escnn"
    installed = Path(find_spec("escnn").submodule_search_locations[0])
    shutil.copytree(installed, package, ignore=shutil.ignore_patterns("_cache", "__pycache__"))
    (package / "group" / "_cache").write_text("")
    return package.parent


def python(code, **environment):
    usual = {name: value for name, value in os.environ.items() if name != "SVFL_CACHE_DIR"}
    env = {**usual, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1", **environment}
    return subprocess.Popen([sys.executable, "-c", code], env=env, stdout=-1, stderr=-1, text=True)


def outcome(process):
    out, err = process.communicate()
    return process.returncode, out.strip(), err.strip()


def files(folder):
    return [path for path in folder.rglob("*.json") if path.is_file()]


def test_a_sealed_installation_keeps_its_tables_with_the_user(sealed, tmp_path):
    done = outcome(python(BUILD, PYTHONPATH=str(sealed), XDG_CACHE_HOME=str(tmp_path / "cache")))
    assert done == (0, "2", "")
    assert files(tmp_path / "cache" / "svfl")
    assert files(sealed) == []


def test_without_our_help_a_sealed_installation_fails(sealed, tmp_path):
    helpless = "import contextlib; from svfl_models.symmetry import escnn_cache as c\n"
    helpless += "c.kept_by_the_user = contextlib.nullcontext\n"
    code, _, err = outcome(python(helpless + BUILD, PYTHONPATH=str(sealed), XDG_CACHE_HOME=str(tmp_path)))
    assert code == 1
    assert "_cache" in err.splitlines()[-1]


def test_a_home_that_cannot_be_written_is_no_obstacle(tmp_path):
    (tmp_path / "home").write_text("a file, in which no folder can be made")
    places = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": "", "TMPDIR": str(tmp_path)}
    assert outcome(python(BUILD, **places)) == (0, "2", "")
    assert [path.name for path in tmp_path.iterdir()] == ["home"], "the temporary folder goes with the process"


def test_two_processes_may_start_on_an_empty_cache(tmp_path):
    both = [python(BUILD, XDG_CACHE_HOME=str(tmp_path)) for _ in range(2)]
    assert [outcome(process) for process in both] == [(0, "2", "")] * 2
    assert files(tmp_path)


def test_where_the_tables_go(monkeypatch, tmp_path):
    monkeypatch.delenv("SVFL_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = escnn_cache.tables_folder.__wrapped__()
    assert folder.parent == tmp_path / "svfl"
    assert folder.name.startswith("escnn-1.")
    assert folder.stat().st_mode & 0o77 == 0


@pytest.fixture
def kept(monkeypatch, tmp_path):
    """A folder of tables, and how often a function was computed that gives everything that a table can hold."""
    monkeypatch.setattr(escnn_cache, "tables_folder", lambda: tmp_path)
    calls = []

    def compute(*arguments, **keywords):
        calls.append(arguments)
        return (np.arange(6.0).reshape(2, 3)[:, ::-1], [((1, 2), 3)], "x", None, np.eye(2) > 0, np.ones(0, np.int64))

    return tmp_path, calls, compute


def assert_equal(one, other):
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, tuple | list):
        for left, right in zip(one, other, strict=True):
            assert_equal(left, right)
    else:
        assert one == other


def test_a_table_is_computed_once_and_is_everybodys_own(kept):
    folder, calls, compute = kept
    first = escnn_cache.Tables("anywhere", verbose=0).cache(compute)
    expected = compute()
    calls.clear()
    assert_equal(first((1, 2), group="D4"), expected)
    for function in (first, escnn_cache.Tables().cache(compute), escnn_cache.Tables().cache()(compute)):
        found = function((1, 2), group="D4")
        assert_equal(found, expected)
        found[0][:] = 7
    assert len(calls) == 1
    first((1, 2), group="D8")
    first((1, 3), group="D4")
    assert len(calls) == 3
    assert len(list(folder.iterdir())) == 3


def test_without_a_folder_it_is_computed_once_in_each_process(kept, monkeypatch):
    folder, calls, compute = kept
    monkeypatch.setattr(escnn_cache, "tables_folder", lambda: None)
    function = escnn_cache.Tables().cache(compute)
    for _ in range(3):
        function(1)
    assert len(calls) == 1
    assert not list(folder.iterdir())


class Payload:
    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)


@pytest.mark.parametrize("damage", ["pickle", "joblib", "text", "half", "other", "deep", "link", "pipe", "large"])
def test_what_is_damaged_or_hostile_is_computed_again_and_never_run(kept, tmp_path_factory, damage, monkeypatch):
    folder, calls, compute = kept
    escnn_cache.Tables().cache(compute)(1)
    (file,) = folder.iterdir()
    whole, marker = file.read_bytes(), tmp_path_factory.mktemp("payload") / "ran"
    file.unlink()
    if damage == "joblib":
        joblib.dump(Payload(marker), file)
    elif damage == "link":
        file.symlink_to("/dev/zero")
    elif damage == "pipe":
        os.mkfifo(file)
    else:
        if damage == "large":
            monkeypatch.setattr(escnn_cache, "LARGEST", 10)
        contents = {
            "pickle": pickle.dumps(Payload(marker)), "text": b"\xff\xfe", "half": whole[:-9], "large": whole,
            "other": b'["object", 1]', "deep": b'["list",' * 100_000,
        }  # fmt: skip
        file.write_bytes(contents[damage])
    calls.clear()
    assert_equal(escnn_cache.Tables().cache(compute)(1), compute())
    assert len(calls) == 2
    assert not marker.exists()


def test_what_cannot_be_written_down_is_computed_again(kept):
    folder, calls, _ = kept
    function = escnn_cache.Tables().cache(lambda: calls.append(0) or object())
    function()
    function()
    assert len(calls) == 2
    assert not list(folder.iterdir())


def test_escnn_never_unpickles(tmp_path):
    """Not even what joblib kept for it where it looks by itself."""
    code = """
import pickle, joblib, sys
def refuse(*_, **__): raise AssertionError("unpickled")
import torch
from svfl_models.symmetry import escnn_cache
pickle.load = pickle.loads = joblib.load = refuse
"""
    done = outcome(python(code + BUILD, XDG_CACHE_HOME=str(tmp_path)))
    assert done == (0, "2", "")
