"""Who may import whom, and what stays out of a light import."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "svfl_data": {"svfl_models", "collectors", "escnn", "lightning", "pybullet", "torch"},
    "svfl_models": {"collectors", "h5py", "pybullet", "cv2"},
    "collectors": {"svfl_models", "torch", "escnn", "lightning", "h5py"},
}
ONLY = {
    "h5py": ["svfl_data/examiner.py", "svfl_data/store.py"],
    "escnn": ["svfl_models/planar_escnn.py"],
}
TORCH_IN_DATA = "svfl_data/torch_samples.py"
"""The one file of svfl_data that may import torch; nothing else there imports it."""


def imports(file: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(str(node.module).split(".")[0])
    return found


@pytest.mark.parametrize("package", FORBIDDEN)
def test_packages_keep_their_distance(package):
    for file in (ROOT / package).rglob("*.py"):
        found = imports(file) & FORBIDDEN[package]
        assert found <= ({"torch"} if str(file.relative_to(ROOT)) == TORCH_IN_DATA else set()), file


@pytest.mark.parametrize(("module", "owners"), ONLY.items())
def test_some_libraries_have_few_owners(module, owners):
    users = [file for package in FORBIDDEN for file in (ROOT / package).rglob("*.py") if module in imports(file)]
    assert sorted(str(file.relative_to(ROOT)) for file in users) == owners


JSON_OF_OUR_OWN = {
    "collectors/replay.py", "svfl_data/checks/verdicts.py", "svfl_data/examiner.py", "svfl_data/verbs/filter.py",
    "svfl_models/escnn_cache.py",
}  # fmt: skip
"""Files that parse what they have made themselves, or one word of a command line."""


def test_json_of_files_is_parsed_in_one_place_which_bounds_it():
    users = {
        str(file.relative_to(ROOT))
        for package in FORBIDDEN
        for file in (ROOT / package).rglob("*.py")
        if "json.loads(" in file.read_text().replace("msgspec.json", "") or "json.load(" in file.read_text()
    }
    assert users == JSON_OF_OUR_OWN


def test_nothing_in_the_store_needs_torch():
    users = [file.name for file in (ROOT / "svfl_data").rglob("*.py") if "svfl_data.torch_samples" in file.read_text()]
    assert users == []


@pytest.mark.parametrize("package", ["svfl_data", "svfl_models", "collectors"])
def test_importing_a_package_is_light(package):
    heavy = ["torch", "pybullet", "rerun", "lightning", "escnn", "matplotlib", "pygame", "hid"]
    code = f"import sys, {package}, {package}.cli; print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == ""


def test_there_is_no_drawer_for_everything():
    assert not [file for package in FORBIDDEN for file in (ROOT / package).rglob("util*.py")]
