"""Reference pages of the public names of the three packages, which mkdocstrings fills from their docstrings."""

from pathlib import Path
from types import ModuleType

import griffe

import collectors
import svfl_data
import svfl_models

ROOT = Path(__file__).resolve().parents[2]


def api_pages() -> dict[str, str]:
    """Return, by path in the site, a page for each package and one for each of its rooms that has public names."""
    pages = {}
    loader = griffe.GriffeLoader(search_paths=[ROOT], allow_inspection=False)
    for package in (svfl_data, svfl_models, collectors):
        name = package.__name__
        source = loader.load(name)
        rooms = names_by_room(package)
        pages[f"reference/{name}/index.md"] = package_page(source, rooms)
        pages |= {f"reference/{name}/{room}.md": room_page(source, room, names) for room, names in rooms.items()}
    return pages


def names_by_room(package: ModuleType) -> dict[str, list[str]]:
    """Return the public names of a package by the room (folder or module) that defines them, both sorted."""
    rooms: dict[str, list[str]] = {}
    for name, home in sorted(package.HOMES.items()):
        rooms.setdefault(home.split(".")[0], []).append(name)
    return dict(sorted(rooms.items()))


def package_page(source: griffe.Object | griffe.Alias, rooms: dict[str, list[str]]) -> str:
    """Return the page of a package: what it is for, and its public names by room, each with its first line."""
    parts = [f"# {source.name}", text(source)]
    for room, names in rooms.items():
        rows = [f"| [`{name}`][{source.name}.{name}] | {first_paragraph(source[name])} |" for name in names]
        parts += [f"## [{room}]({room}.md)", "\n".join(["| name | is |", "| --- | --- |", *rows])]
    return "\n\n".join(parts) + "\n"


def room_page(source: griffe.Object | griffe.Alias, room: str, names: list[str]) -> str:
    """Return the page of a room: its purpose, and a directive of mkdocstrings for each of its public names."""
    directives = [f"::: {source.name}.{name}" for name in names]
    return "\n\n".join([f"# {source.name}: {room}", first_paragraph(source[room]), *directives]) + "\n"


def text(source: griffe.Object | griffe.Alias) -> str:
    """Return the docstring of a module, class, function or constant; empty if it has none."""
    return source.docstring.value if source.docstring else ""


def first_paragraph(source: griffe.Object | griffe.Alias) -> str:
    """Return the first paragraph of a docstring as one line of a table."""
    return " ".join(text(source).split("\n\n")[0].split()).replace("|", r"\|")
