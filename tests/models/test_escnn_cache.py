import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest

from svfl_models import escnn_cache

pytestmark = pytest.mark.slow

BUILD = """
import warnings
warnings.simplefilter("error", UserWarning)
import torch
from svfl_models import planar_escnn
from svfl_models.groups import GROUPS
from svfl_models.kits import kit
from svfl_data.symmetry import OFFSET_PARTS
layers = kit(GROUPS["D4"])
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
    env = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1", **environment}
    return subprocess.Popen([sys.executable, "-c", code], env=env, stdout=-1, stderr=-1, text=True)


def outcome(process):
    out, err = process.communicate()
    return process.returncode, out.strip(), err.strip()


def files(folder):
    return [path for path in folder.rglob("output.pkl") if path.is_file()]


def test_a_sealed_installation_keeps_its_tables_with_the_user(sealed, tmp_path):
    done = outcome(python(BUILD, PYTHONPATH=str(sealed), XDG_CACHE_HOME=str(tmp_path / "cache")))
    assert done == (0, "2", "")
    assert files(tmp_path / "cache" / "svfl")
    assert files(sealed) == []


def test_without_our_help_a_sealed_installation_fails(sealed, tmp_path):
    helpless = (
        "import contextlib; from svfl_models import escnn_cache as c; c.kept_by_the_user = contextlib.nullcontext\n"
    )
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
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = Path(escnn_cache.cache_folder.__wrapped__())
    assert folder.parent == tmp_path / "svfl"
    assert folder.name.startswith("escnn-1.")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert escnn_cache.user_folder().parents[1] == tmp_path / "home" / ".cache"


def test_with_nowhere_to_write_nothing_is_kept(monkeypatch, tmp_path):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("TemporaryFile", "mkdtemp"):
        monkeypatch.setattr(tempfile, name, full)
    assert escnn_cache.cache_folder.__wrapped__() is None
