"""What is built holds every file that belongs to it, and the same from the tree as from the source distribution."""

import tarfile
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from tests.helpers.base_only import PROJECT
from tests.helpers.tracked import ROOT, tracked

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="what belongs to a distribution is what git tracks"),
]

PACKAGES = ("svfl_data", "svfl_models", "collectors")
OF_THE_REPOSITORY = {".gitignore", ".ci"}
"""What a source distribution leaves out, by the first part of the name."""
MADE = {"PKG-INFO", "setup.cfg", "svfl.egg-info"}
"""What building adds to it."""


def members(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_the_wheel_holds_every_tracked_file_of_the_packages_and_no_other(wheel):
    found = {name: content for name, content in members(wheel).items() if ".dist-info/" not in name}
    assert found == {name: (ROOT / name).read_bytes() for name in tracked(*PACKAGES)}


def test_the_source_distribution_holds_every_tracked_file(sdist):
    with tarfile.open(sdist) as archive:
        found = {
            member.name.partition("/")[2]: archive.extractfile(member).read() for member in archive if member.isfile()
        }
    made = {name for name in found if name.partition("/")[0] in MADE}
    ours = [name for name in tracked() if name.partition("/")[0] not in OF_THE_REPOSITORY]
    assert {name: found[name] for name in found.keys() - made} == {name: (ROOT / name).read_bytes() for name in ours}


def test_the_wheel_is_the_same_from_the_tree_as_from_the_source_distribution(wheel, wheel_of_the_tree):
    assert wheel.name == wheel_of_the_tree.name
    assert members(wheel) == members(wheel_of_the_tree)


def test_the_wheel_says_what_the_project_says(wheel):
    content = members(wheel)
    folder = f"svfl-{PROJECT['version']}.dist-info"
    said = Parser().parsestr(content[f"{folder}/METADATA"].decode())
    assert (said["Name"], said["Version"], said["License-Expression"]) == ("svfl", PROJECT["version"], "MIT")
    assert said["Requires-Python"] == PROJECT["requires-python"]
    assert set(said.get_all("Provides-Extra")) == set(PROJECT["optional-dependencies"])
    assert said.get_payload() == (ROOT / "README.md").read_text()
    assert content[f"{folder}/licenses/LICENSE"] == (ROOT / "LICENSE").read_bytes()
    scripts = content[f"{folder}/entry_points.txt"].decode()
    assert all(f"{name} = {target}" in scripts for name, target in PROJECT["scripts"].items())
