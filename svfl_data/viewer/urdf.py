"""The description of an arm (URDF), read so that nothing in it can do harm: a stranger may have written it.

Rerun's reader follows whatever paths a description names and ends the process on some that nest deeply, so it only gets
what has been looked at here: a bounded text, a tree of links and joints, meshes of the description's own folders.
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
"""Elements inside each other, and links or joints, at most; the largest robots have some tens of joints."""
MESHES = (".dae", ".glb", ".gltf", ".obj", ".stl")
PACKAGE = "package://"


def read_urdf(file: Path) -> ElementTree.Element:
    """The root element of a description.

    Args:
        file: Named by the user, be it by a link.

    Raises:
        FormatError: If it is none, too large, nests too deeply, defines entities, or its joints are no tree of links.
    """
    if not file.exists():
        raise FormatError(f"{file}: no such file")
    try:
        content = read_regular(file.resolve(), TEXT_BYTES)
        if b"<!DOCTYPE" in content:
            raise FormatError(f"{file}: not a URDF that is read (it defines entities of its own)")
        parser: Any = ElementTree.XMLPullParser(["start", "end"])  # its type says less than it does
        parser.feed(content)
        root = _bounded(parser)
        parser.close()
        _check_tree(root)
        return root
    except (OSError, ValueError, RuntimeError, ElementTree.ParseError) as error:
        raise FormatError(f"{file}: not a URDF ({printable(' '.join(str(error).split()), 200)})") from error


def mesh_file(file: Path, name: str) -> Path | None:
    """The file of a mesh, if it is an ordinary one of the description's own folders; None otherwise.

    Args:
        file: The description.
        name: What it calls the mesh: a path from its folder, or ``package://`` and a path inside a package, which is
            the description's folder or one of the two above it. A path from its folder may lead into the folder above,
            as packages with folders ``urdf`` and ``meshes`` have it.
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
    """Three numbers of an attribute; zeros if it is missing.

    Raises:
        ValueError: If they are none.
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
            raise ValueError(f"joint {printable(joint.get('name'), 60)} does not hang one link on another")
        hangs_on[ends[1]] = ends[0]
    for link in hangs_on:
        for _ in range(len(hangs_on) + 1):
            if link not in hangs_on:
                break
            link = hangs_on[link]
        else:
            raise ValueError("its joints go round in a circle")
