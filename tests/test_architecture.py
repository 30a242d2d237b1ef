"""Who may import whom: rooms on floors, libraries with few owners, and what stays out of a light import.

A room is a folder directly below a package, or a module there. It may import rooms that stand before it in `FLOORS`,
never one that stands after it, so that there are no circles and a change reaches upwards only.
"""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "svfl_data": {"svfl_models", "collectors", "escnn", "lightning", "pybullet", "torch"},
    "svfl_models": {"collectors", "h5py", "pybullet", "cv2"},
    "collectors": {"svfl_models", "torch", "escnn", "lightning", "h5py"},
}
FLOORS = {
    "svfl_data": (
        "errors symmetry", "system", "schema", "signals", "storage", "datasets", "recording", "checks",
        "maintenance sampling", "replay reports viewer", "commands", "cli",
    ),
    "svfl_models": (
        "configuration programs symmetry", "networks", "training", "cloning latent", "centering",
        "deployment experiments", "commands", "cli",
    ),
    "collectors": (
        "apriltags recording simulation", "observations robots tasks", "environment sources", "teleop", "commands",
        "cli",
    ),
}  # fmt: skip
"""Rooms from the lowest floor to the highest; rooms of one floor do not know each other."""
MOST_FILES = 15
"""Modules of a folder, beside its ``__init__``."""
ONLY = {
    "h5py": ["svfl_data/storage/examiner.py", "svfl_data/storage/store.py"],
    "escnn": ["svfl_models/symmetry/planar_escnn.py"],
}
TORCH_IN_DATA = "svfl_data/sampling/torch_samples.py"
"""The one file of svfl_data that may import torch; nothing else there imports it."""


def modules(file: Path) -> set[str]:
    """Dotted names of all that a file imports; of ``from a.b import c`` both ``a.b`` and ``a.b.c``."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def imports(file: Path) -> set[str]:
    return {name.split(".")[0] for name in modules(file)}


def room(path: str) -> str:
    """The room of a dotted name such as ``svfl_data.storage.reader``."""
    return path.split(".")[1] if "." in path else ""


def upward(package: str, file: Path) -> list[str]:
    """What a file imports from its own floor or a higher one, but for its own room."""
    floors = {name: floor for floor, names in enumerate(FLOORS[package]) for name in names.split()}
    own = room(".".join(file.relative_to(ROOT).with_suffix("").parts))
    others = {room(name) for name in modules(file) if name.startswith(f"{package}.")} & floors.keys() - {own}
    return [f"{own} -> {other}" for other in sorted(others) if floors[other] >= floors.get(own, -1)]


@pytest.mark.parametrize("package", FLOORS)
def test_every_room_has_its_floor_and_no_import_goes_up(package):
    rooms = {path.stem for path in (ROOT / package).iterdir() if path.suffix == ".py" or any(path.glob("*.py"))}
    assert rooms - {"__init__"} == {name for names in FLOORS[package] for name in names.split()}
    files = [
        file for file in (ROOT / package).rglob("*.py") if file.parent != ROOT / package or file.stem != "__init__"
    ]
    assert {str(file): arrows for file in files if (arrows := upward(package, file))} == {}


def test_an_import_that_goes_up_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    file = tmp_path / "svfl_data" / "storage" / "reader.py"
    file.parent.mkdir(parents=True)
    file.write_text("def late():\n    from svfl_data.viewer import show\n    from svfl_data.schema import fields\n")
    assert upward("svfl_data", file) == ["storage -> viewer"]


def test_no_room_is_crowded():
    counts = {
        str(folder.relative_to(ROOT)): len([file for file in folder.glob("*.py") if file.stem != "__init__"])
        for package in FLOORS
        for folder in [ROOT / package, *(path for path in (ROOT / package).rglob("*") if path.is_dir())]
    }
    assert {name: count for name, count in counts.items() if count > MOST_FILES} == {}


def test_the_schema_needs_numpy_only():
    """Whoever writes a robot's driver imports it."""
    code = "import sys, svfl_data.schema.robot; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert not {"torch", "h5py", "scipy", "matplotlib", "cv2", "pybullet"} & {*done.stdout.split()}


@pytest.mark.parametrize("package", FORBIDDEN)
def test_packages_keep_their_distance(package):
    for file in (ROOT / package).rglob("*.py"):
        found = imports(file) & FORBIDDEN[package]
        assert found <= ({"torch"} if str(file.relative_to(ROOT)) == TORCH_IN_DATA else set()), file


@pytest.mark.parametrize(("module", "owners"), ONLY.items())
def test_some_libraries_have_few_owners(module, owners):
    users = [file for package in FORBIDDEN for file in (ROOT / package).rglob("*.py") if module in imports(file)]
    assert sorted(str(file.relative_to(ROOT)) for file in users) == owners


JSON_OF_OUR_OWN = {
    "collectors/sources/replay.py", "svfl_data/checks/findings_cache.py", "svfl_data/commands/new_datasets/filter.py",
    "svfl_data/storage/examiner.py", "svfl_models/symmetry/escnn_cache.py",
}  # fmt: skip
"""Files that parse what they have made themselves, or one word of a command line."""


def test_json_of_files_is_parsed_in_one_place_which_bounds_it():
    users = {
        str(file.relative_to(ROOT))
        for package in FORBIDDEN
        for file in (ROOT / package).rglob("*.py")
        if "json.loads(" in file.read_text().replace("msgspec.json", "") or "json.load(" in file.read_text()
    }
    assert users == JSON_OF_OUR_OWN


def test_nothing_in_the_store_needs_torch():
    name = "svfl_data.sampling.torch_samples"
    users = {str(file.relative_to(ROOT)) for file in (ROOT / "svfl_data").rglob("*.py") if name in file.read_text()}
    assert users == {"svfl_data/__init__.py"}  # for type checkers


@pytest.mark.parametrize("package", ["svfl_data", "svfl_models", "collectors"])
def test_importing_a_package_is_light(package):
    heavy = ["torch", "pybullet", "rerun", "lightning", "escnn", "matplotlib", "pygame", "hid"]
    code = f"import sys, {package}, {package}.cli; print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == ""


def test_there_is_no_drawer_for_everything():
    assert not [file for package in FORBIDDEN for file in (ROOT / package).rglob("util*.py")]


def test_the_page_shows_rooms_arrows_and_ways_as_they_are():
    from docs.architecture import PAGE, generated, page

    text = PAGE.read_text()
    assert all(f"<!-- {name} -->" in text for name in generated())
    assert page(text) == text, "run: python docs/architecture.py --write"


def test_no_test_module_imports_another():
    """What two of them share lies in tests/helpers."""
    for file in (ROOT / "tests").rglob("*.py"):
        of_tests = [name for name in modules(file) if name.startswith("tests.")]
        assert not [name for name in of_tests if ".test_" in name or "conftest" in name], file


def test_no_forked_child_can_go_on_with_the_tests():
    """An error in it would; `tests.helpers.child` ends it whatever happens."""
    forking = {
        str(file.relative_to(ROOT))
        for file in (ROOT / "tests").rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Attribute) and node.attr == "fork" and getattr(node.value, "id", "") == "os"
    }
    assert forking == {"tests/helpers/child.py", "tests/hostile/zygote.py"}  # the latter runs no tests


@pytest.mark.parametrize("package", FLOORS)
def test_tests_follow_the_rooms(package):
    rooms = {path.name for path in (ROOT / "tests" / package).iterdir() if path.is_dir() and path.name[0] != "_"}
    assert rooms <= {name for names in FLOORS[package] for name in names.split()}
