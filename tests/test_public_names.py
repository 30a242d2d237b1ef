"""What is public is named, typed, documented with an example that runs, and loaded when it is first used."""

import ast
import contextlib
import doctest
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import collectors
import svfl_data
import svfl_models
from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode

ROOT = Path(__file__).parents[1]
PACKAGES = {package.__name__: package for package in (svfl_data, svfl_models, collectors)}
DOCUMENTED = [
    f"{name}.{one}" for name, package in PACKAGES.items() for one in package.HOMES if not one.isupper()
]  # constants have their words behind them


@pytest.fixture
def week(tmp_path, monkeypatch):
    """The folder that examples are run in: ``data/week``, two episodes of block picking."""
    dataset = Dataset.create_or_resume(tmp_path / "data" / "week", "centering", 0, {})
    for index in range(2):
        write_episode(make_episode(index, steps=20), dataset.episode_path(index))
    monkeypatch.chdir(tmp_path)
    return dataset


@pytest.mark.parametrize("package", PACKAGES)
def test_names_for_programs_and_for_type_checkers_are_the_same(package):
    tree = ast.parse(Path(PACKAGES[package].__file__).read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {alias.name: node.module for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert typed == {name: f"{package}.{home}" for name, home in PACKAGES[package].HOMES.items()}
    assert dir(PACKAGES[package]) == sorted([*typed, "__version__"])
    assert (Path(PACKAGES[package].__file__).parent / "py.typed").exists()


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_that_is_not_there_is_said(package):
    with pytest.raises(AttributeError, match=f"'{package}'.*'Datset'"):
        PACKAGES[package].Datset  # noqa: B018
    assert PACKAGES[package].__version__[0].isdigit()


def test_asking_for_names_loads_nothing_and_using_one_only_its_own():
    code = (
        "import sys, svfl_data, svfl_models, collectors; dir(svfl_data), dir(svfl_models), dir(collectors);"
        "heavy = {'torch', 'pybullet', 'rerun', 'lightning', 'h5py', 'scipy'}; print(*heavy & sys.modules.keys());"
        "svfl_data.Dataset, svfl_data.Samples, svfl_data.ReplayBuffer; print(*(heavy - {'h5py'}) & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("name", DOCUMENTED)
def test_every_public_name_has_an_example_that_runs(name, week):
    package, _, public = name.partition(".")
    found = getattr(PACKAGES[package], public)
    assert ">>> " in (found.__doc__ or ""), f"{name} has no example"
    known = {one: getattr(PACKAGES[package], one) for one in PACKAGES[package].HOMES if one != "TorchSamples"}
    known |= {"np": np, "contextlib": contextlib, "svfl_data": svfl_data, "dataset": week, public: found}
    if package == "svfl_models" or public == "TorchSamples":
        known["torch"] = importlib.import_module("torch")
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    said: list[str] = []
    for test in finder.find(found, public, globs=known):
        runner.run(test, out=said.append)
    assert not said, "".join(said)
