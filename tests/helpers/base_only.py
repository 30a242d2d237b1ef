"""Hides, in the process that imports this, every library that the base installation of svfl would not have.

What that is follows from pyproject.toml and from what the installed packages say they need.
"""

import re
import sys
import tomllib
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import packages_distributions, requires
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
OURS = {"svfl_data", "svfl_models", "collectors", "tests"}


def distribution(requirement: str) -> str:
    """Normalised name of what a requirement asks for."""
    return re.sub(r"[-_.]+", "-", re.split(r"[\s\[<>=!~;(]", requirement.strip(), maxsplit=1)[0]).lower()


def base() -> set[str]:
    """Distributions of the base installation: the project's own dependencies, theirs, and so on."""
    found: set[str] = set()
    waiting = [distribution(one) for one in PROJECT["dependencies"]]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += [distribution(one) for one in requires(name) or [] if "extra ==" not in one]
    return found


class OnlyBase:
    """Finds modules on the path as Python does, but for those of other distributions."""

    def __init__(self) -> None:
        owners = {module: {distribution(name) for name in names} for module, names in packages_distributions().items()}
        present = base()
        self.shown = {module for module, names in owners.items() if names & present} | OURS | sys.stdlib_module_names

    find_distributions = staticmethod(PathFinder.find_distributions)  # versions are not hidden

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: object = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, path) if name.partition(".")[0] in self.shown else None


def hide() -> None:
    """Leave only what the base installation has."""
    sys.meta_path[:] = [OnlyBase() if finder is PathFinder else finder for finder in sys.meta_path]
    sys.meta_path[:] = [finder for finder in sys.meta_path if "editable" not in getattr(finder, "__name__", "")]
