"""Safe reading of the description of an arm (URDF) from an untrusted source.

Rerun's reader opens any path that a URDF names, and some deeply nested files end its process. Therefore Rerun only gets
files that were checked here: the text has a limited size, links and joints form a tree, and all meshes are in the
folders of the URDF.
"""

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from svfl_data.errors import FormatError
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import read_regular

TEXT_BYTES, MESH_BYTES = 2**24, 2**28
LEVELS, PARTS = 16, 1000
"""Largest nesting depth of elements, and largest number of links or joints; large robots have some tens of joints."""
MESHES = (".dae", ".glb", ".gltf", ".obj", ".stl")
PACKAGE = "package://"


def read_urdf(file: Path) -> ElementTree.Element:
    """Read and check a URDF.

    Args:
        file: URDF file that the user named. It may be a symbolic link.

    Returns:
        The root element.

    Raises:
        FormatError: If the file does not exist, is not a URDF, is too large, nests too deeply or defines entities, or
            if its joints do not connect the links to a tree.
    """
    if not file.exists():
        raise FormatError(f"{file}: no such file")
    try:
        content = read_regular(file.resolve(), TEXT_BYTES)
        if b"<!DOCTYPE" in content:
            raise FormatError(f"{file}: a URDF that defines XML entities is not read")
        parser: Any = ElementTree.XMLPullParser(["start", "end"])  # Any, because its declared type is incomplete
        parser.feed(content)
        root = _bounded(parser)
        parser.close()
        _check_tree(root)
        return root
    except (OSError, ValueError, RuntimeError, ElementTree.ParseError) as error:
        raise FormatError(f"{file}: not a URDF ({printable(' '.join(str(error).split()), 200)})") from error


def mesh_file(file: Path, name: str) -> Path | None:
    """Return the file of a mesh if it is a regular mesh file in the folders of the URDF, otherwise None.

    Args:
        file: URDF file.
        name: Name of the mesh in the URDF: a path relative to the folder of the URDF, or ``package://`` and a path
            inside a package, which is the folder of the URDF or one of the two folders above it. A relative path may
            lead into the folder above, as in packages with the folders ``urdf`` and ``meshes``.
    """
    home = file.resolve().parent
    if name.startswith(PACKAGE):
        places = [(folder, folder / name.removeprefix(PACKAGE)) for folder in (home, *home.parents[:2])]
    else:
        places = [(home.parent, home / name)]
    for folder, place in places:
        try:
            inside = place.resolve().is_relative_to(folder) and not place.is_symlink() and place.is_file()
            if inside and place.suffix.lower() in MESHES and place.stat().st_size <= MESH_BYTES:
                return place
        except (OSError, ValueError):  # such as a name that no file can have
            continue
    return None


def numbers(text: str | None) -> tuple[float, ...]:
    """Parse the three numbers of an attribute.

    Args:
        text: Value of the attribute. None, if the attribute is missing, gives three zeros.

    Raises:
        ValueError: If the text does not consist of three finite numbers.
    """
    found = tuple(float(part) for part in (text or "0 0 0").split())
    if len(found) != 3 or not all(map(math.isfinite, found)):
        raise ValueError(f"{printable(text, 60)!r} are not three numbers")
    return found


def _bounded(parser: Any) -> ElementTree.Element:  # noqa: ANN401
    level, root = 0, None
    for event, element in parser.read_events():
        root = element if root is None else root
        level += 1 if event == "start" else -1
        if level > LEVELS:
            raise ValueError(f"elements nest more than {LEVELS} deep")
    if root is None or root.tag != "robot":
        raise ValueError("its first element is not a robot")
    found: ElementTree.Element = root
    return found


def _check_tree(root: ElementTree.Element) -> None:
    links = {link.get("name", "") for link in root.iterfind("link")}
    hangs_on: dict[str, str] = {}
    joints = root.findall("joint")
    if max(len(links), len(joints)) > PARTS:
        raise ValueError(f"it has {len(links)} links and {len(joints)} joints; at most {PARTS} are read")
    for joint in joints:
        ends = [found.get("link", "") for part in ("parent", "child") if (found := joint.find(part)) is not None]
        if len(ends) != 2 or not set(ends) <= links or ends[1] in hangs_on:
            name = printable(joint.get("name"), 60)
            raise ValueError(f"joint {name} does not join two links of the robot, or its child has another parent")
        hangs_on[ends[1]] = ends[0]
    for link in hangs_on:
        for _ in range(len(hangs_on) + 1):
            if link not in hangs_on:
                break
            link = hangs_on[link]
        else:
            raise ValueError("its joints form a loop")
