"""Programs that train, simulate or show, given a dataset of format 1.0, say in one line what makes a new one of it."""

import sys

import pytest

import collectors.cli
import svfl_models.cli
from tests.helpers.version_1 import version_1
from tests.hostile.programs import LIBRARY, library

PROGRAMS = {"svfl-train": svfl_models.cli.main, "svfl-collect": collectors.cli.main, "library": library}
LINES = (
    "svfl-train centering --data OLD --train-samples 2 --test-samples 2 --epochs 1 --out NEW",
    "svfl-train bc --data OLD --epochs 1 --episodes 2 --out NEW",
    "svfl-train latent --model poe --data OLD --split default --contact-n 0.5 --steps 1 --out NEW",
    "svfl-train centering-table --data OLD --seeds 1 --workers 1 --train-samples 1 --test-samples 1 --out NEW",
    "svfl-collect replay OLD",
    "svfl-collect replay OLD/episode_000000.hdf5",
    *(f"library {name} OLD" for name in LIBRARY if name not in ("load_buffer", "load_statistics", "words")),
)


@pytest.mark.parametrize("line", LINES)
def test_an_old_dataset_is_one_line(line, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CI", "1")
    folder = version_1(tmp_path / "old", indexed=True)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    words = line.replace("OLD", str(folder)).replace("NEW", str(tmp_path / "new")).split()
    monkeypatch.setattr(sys, "argv", words)
    code = PROGRAMS[words[0]]()
    said = capsys.readouterr().err
    assert (code, said.count("\n")) == (1, 1), said
    assert "svfl-data upgrade makes a new dataset of it" in said
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
