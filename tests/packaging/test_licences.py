"""The page on licences names every package of the environment, with its version and its licence."""

import re
import subprocess
import sys

import pytest

from tests.helpers.tracked import ROOT

PAGE = (ROOT / "docs" / "licences.md").read_text()


def test_every_package_of_the_environment_has_its_version_and_a_licence():
    pinned = re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.M)
    rows = re.findall(r"^\| ([\w.-]+) \| (\d\S*) \| [\w, ]+ \| \w[^|]* \|$", PAGE, re.M)
    assert sorted(rows) == sorted(pinned)


@pytest.mark.slow
def test_the_page_is_what_the_installed_packages_say():
    pytest.importorskip("mkdocstrings_handlers", reason="the extra docs is not installed")
    made = subprocess.run(
        [sys.executable, ROOT / "docs" / "licences.py"], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert made.returncode == 0, made.stderr
    assert made.stdout == PAGE
