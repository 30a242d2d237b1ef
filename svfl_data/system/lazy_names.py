"""Names of a package that are imported when somebody asks for them, so that importing the package stays light."""

import importlib
import sys
from collections.abc import Callable, Mapping


def lazy_names(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """What a package's ``__getattr__`` and ``__dir__`` are to be (PEP 562).

    Args:
        package: Its name.
        homes: The module of each name, relative to the package.

    Returns:
        Both functions. ``__version__`` is the version of the distribution.
    """

    def find(name: str) -> object:
        if name == "__version__":
            found: object = distribution_version()
        elif name in homes:
            found = getattr(importlib.import_module(f"{package}.{homes[name]}"), name)
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        setattr(sys.modules[package], name, found)  # the next access finds it at once
        return found

    def names() -> list[str]:
        return sorted([*homes, "__version__"])

    return find, names


def distribution_version() -> str:
    """The version of this software; "unknown" where its files lie somewhere without having been installed."""
    from importlib.metadata import PackageNotFoundError, version  # takes as long as all the rest of an import

    try:
        return version("svfl")
    except PackageNotFoundError:
        return "unknown"
