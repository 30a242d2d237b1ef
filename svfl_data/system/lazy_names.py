"""Import of the public names of a package when they are first used, so that importing the package stays fast."""

import importlib
import sys
from collections.abc import Callable, Mapping


def lazy_names(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return the functions ``__getattr__`` and ``__dir__`` of a package that imports its names lazily (PEP 562).

    Args:
        package: Name of the package.
        homes: Module of each public name, relative to the package.

    Returns:
        The functions ``__getattr__`` and ``__dir__``. Besides the names in `homes` they know ``__version__``, the
        version of the distribution.
    """

    def find(name: str) -> object:
        if name == "__version__":
            found: object = distribution_version()
        elif name in homes:
            found = getattr(importlib.import_module(f"{package}.{homes[name]}"), name)
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        setattr(sys.modules[package], name, found)  # the next access finds the name without this function
        return found

    def names() -> list[str]:
        return sorted([*homes, "__version__"])

    return find, names


def distribution_version() -> str:
    """Return the version of this software, or ``unknown`` if it is not installed as a distribution."""
    from importlib.metadata import PackageNotFoundError, version  # slow: as long as the rest of the import

    try:
        return version("svfl")
    except PackageNotFoundError:
        return "unknown"
