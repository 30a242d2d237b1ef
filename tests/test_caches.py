"""What is kept outside the outputs goes to the user's cache; without one, everything works and nothing is kept."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from collectors.simulation.compiled import compiled
from svfl_data.system.cache_folder import FOLDERS, VARIABLE, confine_caches
from tests.helpers.command_lines import COMMANDS, commands_of, make_data

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
WATCHED = """
import importlib, json, os, pathlib, sys
written = set()
CHANGES = [f"os.{name}" for name in "mkdir rename remove rmdir symlink link chmod truncate".split()]
WRITE = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND

def watch(event, details):
    if event == "open":
        path, mode, flags = details
        if not isinstance(path, int) and (flags or 0) & WRITE:
            written.add(os.fsdecode(path))
    elif event in CHANGES:
        written.add(os.fsdecode(details[0]))

sys.addaudithook(watch)
from svfl_data.system.cache_folder import confine_caches
confine_caches()
modules, lines = json.loads(sys.stdin.read())
for module in modules:
    importlib.import_module(module)
mains = {"svfl-data": "svfl_data.cli", "svfl-train": "svfl_models.cli", "svfl-collect": "collectors.cli"}
for program, command in lines:
    sys.argv = [program, command, "--help"]
    try:
        importlib.import_module(mains[program]).main()
    except SystemExit as ended:
        assert not ended.code
print(json.dumps(sorted(written)))
"""


def modules() -> list[str]:
    files = [file for package in ("svfl_data", "svfl_models", "collectors") for file in (ROOT / package).rglob("*.py")]
    names = [".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for file in files]
    return sorted(name for name in names if not name.endswith("__main__"))


def test_importing_everything_and_asking_for_help_writes_to_the_cache_only(tmp_path):
    lines = [(program, command) for program in COMMANDS for command in sorted(commands_of(program))]
    cache, home, temporary = (tmp_path / name for name in ("cache", "home", "tmp"))
    for folder in (cache, home, temporary):
        folder.mkdir()
    environment = {name: value for name, value in os.environ.items() if name not in (*FOLDERS, VARIABLE)}
    environment |= {"XDG_CACHE_HOME": str(cache), "HOME": str(home), "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-B", "-c", WATCHED], input=json.dumps([modules(), lines]), env=environment, cwd=tmp_path,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = [Path(path) for path in json.loads(done.stdout.splitlines()[-1])]
    allowed = (cache / "svfl", temporary, Path("/dev"))
    assert [path for path in written if not any(path.is_relative_to(place) for place in allowed)] == []
    assert list(home.iterdir()) == []
    assert list(temporary.iterdir()) == []  # what is made there is gone again
    assert any(path.is_relative_to(cache / "svfl" / "numba") for path in written)


def nobody(environment: dict[str, str], *words: object, cwd: Path) -> subprocess.CompletedProcess:
    """Run Python as a user without a home who may read everything and write nothing of others'."""
    capabilities = [
        "--inh-caps",
        "+dac_read_search",
        "--ambient-caps",
        "+dac_read_search",
    ]  # we may lie in /root
    user = ["setpriv", "--reuid=65534", "--clear-groups", *capabilities]
    base = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [*user, sys.executable, "-c", *map(str, words)]
    return subprocess.run(command, env=base | environment, cwd=cwd, capture_output=True, text=True, check=False)


@pytest.fixture
def outside(tmp_path_factory):
    """A folder that belongs to nobody, in a path that everybody may pass."""
    if os.geteuid() != 0 or not shutil.which("setpriv"):
        pytest.skip("only root can become another user, with setpriv")
    folder = tmp_path_factory.mktemp("outside")
    make_data(folder / "data")
    os.chown(folder, 65534, 65534)
    if nobody({}, "import numpy", cwd=folder).returncode:
        pytest.skip("this machine lets no other user start this Python")
    return folder


MAIN = "import sys; from {} import main; sys.exit(main())"
LINES = {
    "collectors.cli": ["centering", "--episodes", "1", "--image-size", "16", "--out", "collected"],
    "svfl_data.cli": ["plot", "data", "--out", "picture.png"],
    "svfl_models.cli": [
        "centering", "--data", "data", "--train-samples", "1", "--test-samples", "1", "--epochs", "1",
        "--preset", "tiny", "--image-size", "16", "--out", "trained",
    ],
}  # fmt: skip


@pytest.mark.parametrize("module", LINES)
def test_a_user_without_a_home_on_a_read_only_installation_can_work(outside, module):
    done = nobody({}, MAIN.format(module), *LINES[module], cwd=outside)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "cache" not in done.stderr.lower()  # a library that complains of its own


def test_where_nothing_can_be_written_only_outputs_are_missed(outside):
    words = LINES["svfl_data.cli"]
    shut = {"TMPDIR": "/nonexistent", "SVFL_CACHE_DIR": "/nonexistent"}
    done = nobody(shut, MAIN.format("svfl_data.cli"), "info", "data", cwd=outside)
    assert (done.returncode, done.stderr) == (0, "")
    (outside / "shut").mkdir()
    done = nobody({}, MAIN.format("svfl_data.cli"), *words[:-1], "shut/picture.png", cwd=outside)
    assert done.returncode == 1
    assert "Permission denied" in done.stderr
    assert done.stderr.count("\n") == 1


def test_machine_code_is_kept_in_the_users_cache_or_nowhere(monkeypatch, tmp_path):
    def half(x):
        return x / 2

    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    usual = numba.config.CACHE_DIR
    assert compiled(half)(3.0) == 1.5
    assert [file.suffix for file in sorted((tmp_path / "cache" / "numba").rglob("*half*"))] == [".nbc", ".nbi"]
    monkeypatch.setenv("SVFL_CACHE_DIR", "/dev/null/nowhere")
    assert compiled(half)(3.0) == 1.5
    assert usual == numba.config.CACHE_DIR  # other functions of other people are not ours to move


def test_what_the_user_has_named_stays(monkeypatch, tmp_path):
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    for name in FOLDERS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MPLCONFIGDIR", "mine")
    confine_caches()
    assert os.environ["MPLCONFIGDIR"] == "mine"
    assert os.environ["TORCHINDUCTOR_CACHE_DIR"] == str(tmp_path / "cache" / "torchinductor")
