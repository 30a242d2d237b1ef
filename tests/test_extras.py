"""With the base installation only, every command and every module says in one line which extra it needs."""

import ast
import json
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from svfl_data.system.extras import EXTRAS, LAST_PYTHON, needs
from tests.helpers.base_only import OURS, PROJECT, base, distribution
from tests.helpers.command_lines import COMMANDS, commands_of, make_data

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PACKAGES = ("svfl_data", "svfl_models", "collectors")
NEEDS = r"needs (\w+), which is not installed; run: pip install 'svfl\[\w+\]'( or pip install 'svfl\[\w+\]')?"
WITHOUT_EXTRAS = {"svfl-data": {"plot", "topdown", "view", "card"}, "svfl-train": None, "svfl-collect": None}
"""Verbs that need an extra; None: all."""

IMPORT_ALL = """
import importlib, json, sys
from tests.helpers.base_only import hide
hide()
said = {}
for module in json.loads(sys.stdin.read()):
    try:
        importlib.import_module(module)
        said[module] = None
    except Exception as error:
        said[module] = f"{type(error).__name__}: {error}"
print(json.dumps(said))
"""
RUN_ALL = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
from tests.helpers.base_only import hide
hide()
from collectors import cli as collect
from svfl_data import cli as data
from svfl_models import cli as train
mains = {"svfl-data": data.main, "svfl-train": train.main, "svfl-collect": collect.main}
said = []
for program, words in json.loads(sys.stdin.read()):
    sys.argv, errors = [program, *words], io.StringIO()
    with redirect_stderr(errors), redirect_stdout(io.StringIO()):
        code = mains[program]()
    said.append((program, words[0], code, errors.getvalue()))
print(json.dumps(said))
"""


def answers(script: str, asked: object) -> object:
    done = subprocess.run(
        [sys.executable, "-c", script], input=json.dumps(asked), cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def modules() -> list[str]:
    files = [file.relative_to(ROOT) for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    return [".".join(file.with_suffix("").parts).removesuffix(".__init__") for file in files]


def test_every_module_is_imported_or_says_which_extra_it_needs():
    said = answers(IMPORT_ALL, [name for name in modules() if not name.endswith("__main__")])
    failures = {module: words for module, words in said.items() if words is not None}
    for module, words in failures.items():
        assert re.fullmatch(rf"MissingPackageError: (svfl_data|svfl_models|collectors)[\w.]* {NEEDS}", words), module
    assert not [module for module in failures if ".commands" in module or module.endswith(".cli")]
    in_data = [module for module in failures if module.startswith("svfl_data.")]
    assert {module for module in in_data if not module.startswith("svfl_data.viewer")} == {
        "svfl_data.reports.dataset_card", "svfl_data.reports.plot", "svfl_data.reports.plot_curves",
        "svfl_data.reports.plot_strips", "svfl_data.sampling.torch_samples",
    }  # fmt: skip


def test_every_command_works_or_says_which_extra_it_needs(tmp_path):
    data = make_data(tmp_path / "data")
    asked = [(program, words) for program, lines in COMMANDS.items() for words in lines(data, tmp_path).values()]
    assert {(program, words[0]) for program, words in asked} == {
        (program, command) for program in COMMANDS for command in commands_of(program)
    }
    for program, command, code, errors in answers(RUN_ALL, asked):
        needing = WITHOUT_EXTRAS[program]
        if needing is None or command in needing:
            assert code == 1, (program, command)
            assert re.fullmatch(rf"{program}: {command} {NEEDS}\n", errors), errors
        else:
            assert (code, errors) == (0, ""), (program, command)


def test_the_extras_are_those_of_the_project():
    extras = {extra: {distribution(one) for one in asked} for extra, asked in PROJECT["optional-dependencies"].items()}
    groups = {"all", "dev", "bench"}  # of other extras, and for our own work
    owners = packages_distributions()
    for module, named in EXTRAS.items():
        (owner,) = {distribution(name) for name in owners[module]}
        owner = {"pybullet-data": "pybullet"}.get(owner, owner)
        assert {extra for extra, asked in extras.items() if owner in asked} - groups == set(named), module


@pytest.mark.parametrize("library", ["pybullet", "pybullet_data", "gymnasium", "numba"])
def test_where_pybullet_has_no_wheels_the_python_that_has_them_is_named(library, monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 13, 1, "final", 0))
    assert needs(library) == (
        f"needs {library}, which is not installed; its extra needs pybullet, which has no wheels for Python 3.13: "
        "with Python 3.11 run: pip install 'svfl[sim]'"
    )
    assert needs("cv2") == "needs cv2, which is not installed; run: pip install 'svfl[real]'"


def test_the_last_pythons_of_extras_are_the_markers_of_the_project():
    markers = {
        (extra, distribution(asked), asked.partition(";")[2].strip())
        for extra, all_asked in PROJECT["optional-dependencies"].items()
        for asked in all_asked
        if ";" in asked
    }
    assert markers == {
        (extra, library, f"python_version < '{major}.{minor + 1}'")
        for extra, (library, (major, minor)) in LAST_PYTHON.items()
    }


def test_every_library_that_is_imported_has_its_extra():
    owners, present = packages_distributions(), base()
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            for library in imported(file) - sys.stdlib_module_names - OURS - {"escnn"}:
                known = library in EXTRAS or {distribution(name) for name in owners[library]} <= present
                assert known, (file, library)


def imported(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


@pytest.mark.parametrize("asking", ["import torch", "import importlib.util; importlib.util.find_spec('torch')"])
def test_other_libraries_find_out_for_themselves_what_there_is(asking):
    script = f"""
from tests.helpers.base_only import hide
hide()
import svfl_data
try:
    {asking}
except ModuleNotFoundError as error:
    assert type(error) is ModuleNotFoundError, error
"""
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True)
