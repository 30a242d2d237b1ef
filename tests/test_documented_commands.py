"""The commands on the pages work as they stand, one after the other, but for sizes: few episodes, small networks."""

import re

import pytest

import collectors.cli
import svfl_data.cli
import svfl_models.cli
from svfl_data.system.command_line import main
from tests.helpers.pages import program_calls
from tests.helpers.version_1 import version_1

pytestmark = pytest.mark.slow

PARSERS = {"svfl-collect": collectors.cli, "svfl-data": svfl_data.cli, "svfl-train": svfl_models.cli}
NOT_RUN = {
    "svfl-collect teleop": "asks for a person, a device and a display; tests/collectors/teleop",
    "svfl-collect calibrate": "asks for pictures of a printed board; tests/collectors/apriltags",
    "svfl-train (centering-|bc-table)": "a table of many trainings; tests/svfl_models/experiments",
    "svfl-data view (?!.*--out)|.* --rerun": "opens a window or a server; tests/svfl_data/viewer",
    "svfl-train (bc --config|rerun)": "asks for the run of a call before it; tests/svfl_models/configuration",
    "svfl-train evaluate .*--(data|env) ": "asks for other data or another package; tests/svfl_models/cloning",
    ".* --(help|version)$": "prints and ends; tests/svfl_data/system/test_command_line.py",
    ".* (data/mine|out/wiping)": "asks for the robot of docs/recording.md; tests/test_docs.py",
}
"""Calls that are parsed only, by tests/test_docs.py: how they begin, and why."""
SMALLER = {
    "svfl-collect centering": "--episodes 16 --workers 1",
    "svfl-collect expert": "--episodes 4 --workers 1",
    "svfl-collect expert --task all": "--episodes 1",
    "svfl-collect expert --task block_picking": "--episodes 10",
    "svfl-collect expert --task block_picking --tags": "--episodes 1",
    "svfl-collect policy": "--episodes 1",
    "svfl-train centering": "--train-samples 4 --test-samples 4 --epochs 1",
    "svfl-train bc": "--episodes 10 --preset tiny --epochs 1",
    "svfl-train latent": "--steps 1 --batch-size 2",
    "svfl-train latent-eval": "--episodes 2",
    "svfl-train evaluate": "--episodes 1 --workers 1",
}
"""Options that are added at the end of calls that begin like this; the last one of its kind counts."""
MAKERS = (
    r"svfl-collect (expert|centering|tags) ", r"svfl-train (latent|bc) ", r"svfl-train centering .*--encoder",
)  # fmt: skip
"""What is called first, in this order, because other calls ask for what it makes."""


def runnable() -> list[list[str]]:
    calls = [words for words in program_calls() if not any(re.match(one, " ".join(words)) for one in NOT_RUN)]
    return sorted(
        calls, key=lambda words: next((n for n, one in enumerate(MAKERS) if re.match(one, " ".join(words))), 9)
    )


def smaller(words: list[str]) -> list[str]:
    line = " ".join(words) + " "
    return [
        *words,
        *(word for start, added in SMALLER.items() if line.startswith(f"{start} ") for word in added.split()),
    ]


def test_at_least_half_of_the_calls_are_run():
    assert len(runnable()) >= len(program_calls()) / 2


def test_the_calls_work(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    version_1(tmp_path / "data" / "old")
    for words in map(smaller, runnable()):
        code = main(PARSERS[words[0]].build_parser(), words[1:])
        assert code == 0, (words, capsys.readouterr().err)
