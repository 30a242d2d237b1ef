"""Same seed, same bytes: over which processors (docs/simulation.md)."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.cpu_settings import SETTINGS

ROOT = Path(__file__).parents[3]
TRIGONOMETRIC = {"sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "sincos"}
EXPONENTIAL = {"exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "float_power", "cbrt"}
BLAS = {"linalg", "dot", "vdot", "inner", "matmul", "tensordot", "einsum", "vecdot", "matvec", "vecmat"}
COLLECT = """
import sys
from collectors import cli
few = ["--seed", "0", "--image-size", "16", "--out"]
out = sys.argv[-1]
for words in (["centering", "--episodes", "2"], ["expert", "--task", "block_picking", "--episodes", "1"]):
    sys.argv = ["svfl-collect", *words, *few, f"{out}/{words[0]}"]
    assert cli.main() == 0
"""


@pytest.mark.parametrize("folder", ["collectors/simulation", "collectors/tasks"])
def test_the_simulation_uses_nothing_of_numpy_that_differs_between_processors(folder):
    """With AVX-512, NumPy takes other approximations; those of `math` are the C library's. BLAS adds as it likes."""
    for file in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            assert not isinstance(getattr(node, "op", None), ast.MatMult), f"{file}:{node.lineno}: @"
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "np":
                assert node.attr not in TRIGONOMETRIC | EXPONENTIAL | BLAS, f"{file}:{node.lineno}: np.{node.attr}"


def collected(folder: Path, environment: dict[str, str]) -> dict[str, bytes]:
    folder.mkdir()
    subprocess.run([sys.executable, "-c", COLLECT, str(folder)], cwd=ROOT, env=os.environ | environment, check=True)
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*.hdf5")}


@pytest.mark.slow
def test_libraries_that_use_less_of_a_processor_give_the_same_bytes(tmp_path):
    usual = collected(tmp_path / "usual", {})
    assert len(usual) == 3
    assert collected(tmp_path / "old", SETTINGS["old"]) == usual
