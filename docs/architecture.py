"""Draw the generated parts of docs/architecture.md from the code, which a test compares with the page.

python docs/architecture.py          # print them
python docs/architecture.py --write  # put them into the page
"""

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.test_architecture import FLOORS, modules, room  # noqa: E402

PAGE = ROOT / "docs" / "architecture.md"
WAYS = {
    "image": (
        "collectors.recording.loop.record", "collectors.simulation.world.World.observe",
        "collectors.simulation.camera.Camera.render", "svfl_data.storage.store.write_episode",
        "svfl_data.storage.chunk_encoding.Encoding.encode", "svfl_data.sampling.centering_samples.load_centering",
        "svfl_data.storage.header.header", "svfl_data.sampling.centering_samples.sample_of",
        "svfl_data.storage.stored_array.StoredArray.rows", "svfl_models.centering.data.Crops.__getitem__",
        "svfl_models.networks.image_crops.centre_crop", "svfl_models.networks.visual_force.VisualForceEncoder.forward",
        "svfl_models.networks.encoders.VisionEncoder.forward",
    ),
    "wrench": (
        "collectors.recording.loop.record", "collectors.simulation.world.World.step",
        "collectors.simulation.wrist_sensor.wrench_from_reaction", "svfl_data.storage.store.write_episode",
        "svfl_data.sampling.centering_samples.load_centering", "svfl_data.storage.header.header",
        "svfl_data.sampling.windows.wrench_window", "svfl_models.centering.data.Crops.__getitem__",
        "svfl_models.networks.visual_force.VisualForceEncoder.forward",
        "svfl_models.networks.encoders.ForceEncoder.forward", "svfl_models.networks.encoders.SelfAttention.forward",
    ),
}  # fmt: skip
"""Functions that process an image and a wrench between the sensor and the network, in order."""


def purpose(path: Path) -> str:
    """Return the first line of a subpackage's docstring.

    Args:
        path: Folder of the subpackage, or path of its module without a suffix.
    """
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return (ast.get_docstring(ast.parse(file.read_text())) or "").splitlines()[0]


def arrows(package: str) -> dict[str, set[str]]:
    """Return the subpackages that each subpackage of a package imports."""
    names = {name for floor in FLOORS[package] for name in floor.split()}
    found: dict[str, set[str]] = {}
    for file in (ROOT / package).rglob("*.py"):
        own = room(".".join(file.relative_to(ROOT).with_suffix("").parts))
        others = {room(name) for name in modules(file) if name.startswith(f"{package}.")}
        found.setdefault(own, set()).update(others & names - {own})
    return {name: found.get(name, set()) for name in names}


def shortest(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return a graph without the edges that follow from other edges."""

    def below(name: str) -> set[str]:
        return graph[name] | {deep for one in graph[name] for deep in below(one)}

    return {
        name: {one for one in ones if not any(one in below(other) for other in ones)} for name, ones in graph.items()
    }


def rooms(package: str) -> str:
    """Return the Markdown table and the diagram of a package's subpackages."""
    graph = arrows(package)
    lines = ["| layer | subpackage | files | content |", "| --- | --- | --- | --- |"]
    for floor, names in enumerate(FLOORS[package], start=1):
        for name in names.split():
            path = ROOT / package / name
            files = len([file for file in path.rglob("*.py") if file.stem != "__init__"]) if path.is_dir() else 1
            lines.append(f"| {floor} | `{name}` | {files} | {purpose(path)} |")
    count = sum(map(len, graph.values()))
    lines += [
        "",
        f"{count} imports between subpackages; the diagram omits those that follow from others:",
        "",
        "```mermaid",
        "flowchart BT",
    ]
    lines += [f"    {name} --> {other}" for name, ones in sorted(shortest(graph).items()) for other in sorted(ones)]
    return "\n".join([*lines, "```"])


def way(name: str) -> str:
    """Return the diagram of a data flow, one of `WAYS`."""
    places = [
        place.rsplit(".", 2) if place.split(".")[-2][0].isupper() else place.rsplit(".", 1) for place in WAYS[name]
    ]
    boxes = [f'    n{number}["{".".join(place[1:])}<br/><i>{place[0]}</i>"]' for number, place in enumerate(places)]
    links = "    " + " --> ".join(f"n{number}" for number in range(len(places)))
    return "\n".join(["```mermaid", "flowchart TB", *boxes, links, "```"])


def generated() -> dict[str, str]:
    """Return every generated part of the page, by name."""
    return {package: rooms(package) for package in FLOORS} | {name: way(name) for name in WAYS}


def page(text: str) -> str:
    """Return the text of a page with its generated parts made anew."""
    for name, part in generated().items():
        pattern = rf"(<!-- {name} -->\n)(?:(?!<!-- end -->).)*(<!-- end -->)"
        text = re.sub(pattern, lambda match, part=part: f"{match[1]}{part}\n{match[2]}", text, flags=re.DOTALL)
    return text


if __name__ == "__main__":
    if "--write" in sys.argv:
        PAGE.write_text(page(PAGE.read_text()))
    else:
        print(*generated().values(), sep="\n\n")
