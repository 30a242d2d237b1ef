"""One version: that of pyproject.toml, which the installed package, its modules and the changelog name."""

import re
from importlib.metadata import version

import collectors
import svfl_data
import svfl_models
from tests.helpers.base_only import PROJECT
from tests.helpers.tracked import ROOT


def test_packages_and_installation_have_the_version_of_the_project():
    versions = {version("svfl"), *(package.__version__ for package in (svfl_data, svfl_models, collectors))}
    assert versions == {PROJECT["version"]}


def test_the_changelog_has_the_version_after_what_is_not_released():
    text = (ROOT / "CHANGELOG.md").read_text()
    headings = re.findall(r"^## (.*)$", text, re.M)
    assert headings[0] == "Unreleased"
    assert re.fullmatch(rf"{re.escape(PROJECT['version'])} - \d{{4}}-\d\d-\d\d", headings[1]), headings[1]
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(re.findall(r"^### (.*)$", text, re.M)) <= kinds
