"""Make docs/licences.md: version and licence of every package that the environment of constraints.txt has.

python docs/licences.py          # print the page
python docs/licences.py --write  # write it; `make env` first, since licences are read from the installed packages
"""

import re
import sys
import tomllib
from importlib.metadata import metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "licences.md"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HEAD = """# Licences of dependencies

SVFL itself is under the [MIT licence](../LICENSE), and ships no code of others. This page lists what installations of
it bring along: every package of `constraints.txt`, direct or by way of another, with the licence that its own metadata
name. It is made by `python docs/licences.py --write`; a test compares.

The column "for" names the extras that need a package: `base` is the installation without extras, `dev` is for work on
SVFL itself. Wheels may contain libraries under further licences (OpenBLAS in NumPy, FFmpeg in OpenCV, HDF5 in h5py);
their `.dist-info` folders hold the texts. The models of `pybullet_data` have licences of their own beside them.

Licences with conditions on derived works, of which none is changed or copied here: {copyleft}.

| package | version | for | licence |
| --- | --- | --- | --- |
"""
COPYLEFT = re.compile(r"\b(L?GPL|MPL|GNU|Mozilla)")
LEFT_OUT = {"all", "bench"}
"""Extras that consist of others, or that the environment does not have."""


def licence(name: str) -> str:
    """Return the licence that the metadata of an installed package name, in as few words as they have for it.

    Args:
        name: Name of the package.

    Raises:
        ValueError: If they name none.
    """
    said = metadata(name)
    words = str(said.get("License-Expression") or said.get("License") or "").strip()
    if words and "\n" not in words and words != "UNKNOWN":
        return words
    classifiers = [one.rpartition(" :: ")[2] for one in said.get_all("Classifier") or [] if one.startswith("License")]
    if not classifiers:
        raise ValueError(f"{name}: its metadata name no licence; look at its homepage, and say here what was found")
    return " or ".join(classifiers)


def users(packages: set[str]) -> dict[str, set[str]]:
    """Return the extras that need each package, directly or by way of others; the base installation is ``base``.

    Args:
        packages: Normalised names of the packages that are installed.
    """
    extras = PROJECT["optional-dependencies"]
    found: dict[str, set[str]] = {package: set() for package in packages}
    for extra in extras.keys() - LEFT_OUT:
        for package in _needed(extras[extra]) & packages:
            found[package].add(extra)
    found["escnn"] = {"models"}  # installed without dependencies, by a command of its own: docs/installation.md
    return found | {package: {"base"} for package in _needed(PROJECT["dependencies"])}


def _needed(asked: list[str]) -> set[str]:
    """Names of the packages that satisfy some requirements on this machine, with all that those need."""
    found: set[tuple[str, frozenset[str]]] = set()
    waiting = [(Requirement(words), frozenset[str]()) for words in asked]
    while waiting:
        one, extras = waiting.pop()
        entry = (canonicalize_name(one.name), frozenset(one.extras))
        wanted = one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in extras | {""})
        if wanted and entry not in found and entry[0] != PROJECT["name"]:
            found.add(entry)
            waiting += [(Requirement(words), entry[1]) for words in requires(entry[0]) or []]
    return {name for name, _ in found}


def page() -> str:
    """Return the page as Markdown."""
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split("\n") if "==" in line)
    needed = users({canonicalize_name(name) for name in pinned})
    rows, copyleft = [], []
    for name, version in sorted(pinned.items(), key=lambda one: canonicalize_name(one[0])):
        terms, extras = licence(name), needed[canonicalize_name(name)]
        of_users = sorted(extras - {"dev"}) or ["dev"]
        rows.append(f"| {name} | {version} | {', '.join(of_users)} | {terms} |")
        if COPYLEFT.search(terms):
            copyleft.append(f"{name} ({terms})")
    return HEAD.format(copyleft=", ".join(copyleft)) + "\n".join(rows) + "\n"


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        PAGE.write_text(page())
    else:
        print(page(), end="")
