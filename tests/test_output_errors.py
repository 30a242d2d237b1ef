"""What an operating system refuses, in any command, is one line and exit code 1; output that cannot be written, too."""

import errno
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from svfl_data.system.refused import POSSIBLE, refusal
from tests.helpers.command_lines import data_commands, make_data
from tests.helpers.refusals import EACH

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
REFUSED = sorted({*POSSIBLE, errno.ENOENT, errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTEMPTY})
PROGRAM = "import sys; from svfl_data.cli import main; sys.exit(main())"


@pytest.mark.parametrize(("program", "command"), EACH)
def test_every_command_says_what_the_system_refuses_in_one_line(refused, program, command):
    for number in REFUSED:
        code, said = refused(program, command, OSError(number, os.strerror(number), "data/of\nmine"))
        assert code == 1
        assert said.startswith(f"{program}: data/of\\nmine: {os.strerror(number)}"), said
        assert said.count("\n") == 1
        assert POSSIBLE.get(number, "") in said


@pytest.mark.parametrize(("program", "command"), EACH)
@pytest.mark.parametrize("error", [MemoryError(), MemoryError("Unable to allocate 4. GiB for an array")])
def test_every_command_says_that_memory_is_short_in_one_line(refused, program, command, error):
    code, said = refused(program, command, error)
    assert code == 1
    assert said.startswith(f"{program}: not enough memory: ")
    assert said.count("\n") == 1


def test_a_mistake_of_ours_is_not_hidden(refused):
    with pytest.raises(ZeroDivisionError):
        refused("svfl-data", "info", ZeroDivisionError())
    with pytest.raises(ModuleNotFoundError):
        refused("svfl-data", "info", ModuleNotFoundError("no svfl_data.x", name="svfl_data.x"))


def test_both_files_of_a_refused_rename_are_named():
    words = refusal(OSError(errno.EXDEV, "Invalid cross-device link", "a", None, "b"))
    assert words == "a -> b: Invalid cross-device link"
    assert refusal(OSError("what HDF5 says")) == "what HDF5 says"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return make_data(tmp_path_factory.mktemp("output") / "dataset")


def run(*words, unbuffered=False, code=PROGRAM, **how):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    environment |= {"PYTHONUNBUFFERED": "1"} if unbuffered else {}
    environment |= how.pop("env", {})
    how = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | how
    command = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False, **how)


@pytest.mark.slow
@pytest.mark.parametrize("unbuffered", [False, True])
@pytest.mark.parametrize("words", [["--help"], ["info"], ["info", "--json"], ["validate"], ["stats", "--help"]])
def test_output_that_cannot_be_written_is_said(dataset, words, unbuffered):
    with open("/dev/full", "wb") as full:
        where = [] if "--help" in words else [dataset]
        done = run(words[0], *where, *words[1:], stdout=full, unbuffered=unbuffered)
    assert done.returncode == 1
    assert done.stderr.startswith(b"svfl-data: ")
    assert b"No space left on device" in done.stderr
    assert done.stderr.count(b"\n") == 1


@pytest.mark.parametrize("unbuffered", [False, True])
def test_a_reader_that_leaves_is_no_mistake(dataset, unbuffered):
    read, write = os.pipe()
    os.close(read)
    done = run("info", dataset, stdout=write, unbuffered=unbuffered)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("unbuffered", [False, True])
def test_errors_that_cannot_be_written_leave_the_exit_code(dataset, unbuffered):
    with open("/dev/full", "wb") as full:
        assert run("info", dataset / "nowhere", stderr=full, unbuffered=unbuffered).returncode == 1
        assert run("nothing", stderr=full, unbuffered=unbuffered).returncode in (1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("closed", [1, 2])
def test_no_file_takes_the_place_of_a_closed_stream(dataset, tmp_path, closed):
    """A library's own output would land in it."""
    closing = functools.partial(os.close, closed)
    for command in ("info", "merge", "filter"):
        words = data_commands(dataset, tmp_path / f"{closed}")[command]
        (tmp_path / f"{closed}").mkdir(exist_ok=True)
        assert run(*words, preexec_fn=closing).returncode == 0
    code = "import os; from svfl_data.system import standard_streams as s; s.prepare(); "
    code += "print(os.open('x', os.O_CREAT | os.O_WRONLY), file=open('told', 'w'))"
    subprocess.run(
        [sys.executable, "-c", code],
        preexec_fn=closing,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
    )
    assert int((tmp_path / "told").read_text()) > 2


ASCII = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}


@pytest.mark.slow
@pytest.mark.parametrize("terminal", [ASCII, {"PYTHONIOENCODING": "ascii"}])
@pytest.mark.parametrize("command", sorted(data_commands(Path(), Path())))
def test_names_that_a_terminal_cannot_show_are_no_obstacle(tmp_path, terminal, command):
    folder = tmp_path / "été-雪"
    data, out = make_data(folder / "data"), folder / "out"
    out.mkdir()
    if command == "stats":
        assert run(*data_commands(data, out)["split"]).returncode == 0
    done = run(*data_commands(data, out)[command], env=terminal)
    assert done.returncode == 0, done.stderr
    assert done.stderr == b""
    assert done.stdout.isascii()


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted(data_commands(Path(), Path())))
def test_names_that_are_no_text_are_one_line_or_work(tmp_path, command):
    folder = tmp_path / os.fsdecode(b"\xff\xfe")
    data, out = make_data(folder / "data"), folder / "out"
    out.mkdir()
    done = run(*data_commands(data, out)[command])
    assert done.returncode in (0, 1)
    assert b"Traceback" not in done.stderr
    assert done.stderr.count(b"\n") == done.returncode
