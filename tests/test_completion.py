"""Completion by a shell: what the programs answer to argcomplete's protocol, as bash speaks it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from svfl_data.cli import main
from svfl_data.system.command_line.completion import PROGRAMS, SHELLS

ROOT = Path(__file__).parents[1]
MODULES = dict(zip(PROGRAMS, ("svfl_data.cli", "collectors.cli", "svfl_models.cli"), strict=True))
START = "import sys; from {} import main; sys.argv[0] = {!r}; sys.exit(main())"


def offered(line, folder=ROOT):
    """The words that a program offers for the end of a command line."""
    program = line.split()[0]
    answer = folder / "answer.txt"
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_SHELL": "bash", "_ARGCOMPLETE_IFS": "\n", "COMP_TYPE": "9"}
    asked |= {"_ARGCOMPLETE_SUPPRESS_SPACE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}
    asked |= {"COMP_LINE": line, "COMP_POINT": str(len(line))}
    asked |= {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    code = START.format(MODULES[program], program)
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, cwd=folder, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
    return set(answer.read_text().split("\n")) - {""}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("svfl-data va", {"validate"}),
        ("svfl-data --v", {"--version"}),
        ("svfl-data filter a b --su", {"--success"}),
        ("svfl-data completion ", set(SHELLS)),
        ("svfl-collect expert --task block_pi", {"block_picking"}),
        ("svfl-collect policy --task drawer_", {"drawer_opening", "drawer_closing"}),
        ("svfl-collect expert --cameras wr", {"wrist"}),
        ("svfl-collect expert --cameras front,side_", {"front,side_left", "front,side_right"}),
        ("svfl-collect teleop --input-device ", {"keyboard", "gamepad", "spacemouse", "script"}),
        ("svfl-collect expert --robot ur", {"ur5e_sim"}),
        ("svfl-train check c --data d --pre", {"--precision"}),
        ("svfl-train centering-t", {"centering-table"}),
    ],
)
def test_words_are_completed(line, words, tmp_path):
    assert offered(line, tmp_path) == words


def test_files_are_completed(tmp_path):
    (tmp_path / "week").mkdir()
    assert offered("svfl-data info we", tmp_path) == {"week/"}


@pytest.mark.parametrize("shell", SHELLS)
def test_the_code_for_a_shell_names_all_programs(shell, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["svfl-data", "completion", shell])
    assert main() == 0
    code = capsys.readouterr().out
    assert all(program in code for program in PROGRAMS)


def test_bash_takes_the_code(tmp_path):
    code = subprocess.run(
        [sys.executable, "-c", START.format("svfl_data.cli", "svfl-data"), "completion", "bash"],
        capture_output=True, text=True, cwd=ROOT, check=True,
    ).stdout  # fmt: skip
    done = subprocess.run(
        ["bash", "-c", f"{code}\ncomplete -p svfl-data svfl-collect svfl-train"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.count("_python_argcomplete") == len(PROGRAMS)


def test_an_ordinary_start_loads_nothing_of_it():
    code = "import sys, svfl_data.cli; svfl_data.cli.build_parser(); print('argcomplete' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout == "False\n"
