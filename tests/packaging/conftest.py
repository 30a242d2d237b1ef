"""The distributions of the present tree, built once for all tests of a worker."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.tracked import ROOT, tracked


@pytest.fixture(scope="session")
def tree(tmp_path_factory) -> Path:
    """A copy of the tracked files, in which building leaves its traces."""
    folder = tmp_path_factory.mktemp("tree")
    for name in tracked():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="session")
def sdist(tree, tmp_path_factory) -> Path:
    (found,) = _build(tree, tmp_path_factory.mktemp("sdist"), "--sdist")
    return found


@pytest.fixture(scope="session")
def wheel(sdist, tmp_path_factory) -> Path:
    """The wheel that is built from the source distribution, as ``python -m build`` does."""
    folder = tmp_path_factory.mktemp("unpacked")
    shutil.unpack_archive(sdist, folder, filter="data")
    (source,) = folder.iterdir()
    (found,) = _build(source, tmp_path_factory.mktemp("wheel"), "--wheel")
    return found


@pytest.fixture(scope="session")
def wheel_of_the_tree(tree, sdist, tmp_path_factory) -> Path:
    (found,) = _build(tree, tmp_path_factory.mktemp("wheel_of_the_tree"), "--wheel")
    return found


def _build(source: Path, out: Path, kind: str) -> list[Path]:
    """With the setuptools of this environment, which constraints.txt pins; nothing is downloaded."""
    words = [sys.executable, "-m", "build", "--no-isolation", kind, "--outdir", str(out), str(source)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=out)
    assert done.returncode == 0, done.stdout + done.stderr
    return list(out.iterdir())
