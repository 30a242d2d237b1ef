"""Every block of code in the documentation is run or checked, or it is said here why not."""

import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collectors.recording.loop import record
from collectors.simulation.bullet import pybullet
from collectors.simulation.world import World
from collectors.sources.tagged_block import wear_tags
from collectors.sources.tagged_expert import TAG_CAMERAS, SimulatedTagCamera
from collectors.teleop.devices.device import DeviceLostError
from docs.site.flowcharts import parsed, svg
from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.observation import Frame
from svfl_data.schema.optics import Calibration
from svfl_data.storage.store import write_episode
from svfl_models.commands import bc, centering, latent
from svfl_models.configuration.resolving import complete, resolve
from svfl_models.configuration.yaml_file import read_yaml
from tests.helpers.builders import make_episode
from tests.helpers.collectors import SMALL
from tests.helpers.demonstrations import demonstrations
from tests.helpers.pages import PAGES, PROGRAMS, ROOT, blocks, command_lines, name, python_of

ELSEWHERE = {
    "docs/adding-a-task.md": "tests/collectors/tasks/test_adding_a_task.py",
    "docs/recording.md": "tests/test_docs.py",
    "docs/symmetry.md": "tests/test_docs.py",
}
"""Pages whose Python is run by tests that look closer, and where these are."""
NOT_RUN = {
    r"(uv )?pip install ": "changes the environment; `make env` installs the same",
    r"git clone ": "asks for a repository; CI runs on a fresh clone",
    r"pip wheel ": "tests/packaging builds and installs the same wheel",
    r"python3.11 -m venv|\.venv/bin/pip ": "makes an environment",
    r"\.venv/bin/python -m (pytest|tests\.)|SVFL_\w+=\w+ ": "runs the tests, or for hours",
    r"rerun ": "opens a window",
    r"echo 'SUBSYSTEMS": "changes the machine, as root",
    r'eval "\$\(svfl-data completion ': "for the shell's own file; tests/test_completion.py completes",
    r"data/centering/$": "a list of files, not code",
    r"RGB-D image|coarse arm|full meshes": "what a benchmark printed",
    r"with EpisodeWriter\(": "a piece of the program above it",
    r'"button_pressing": ': "tests/collectors/tasks/test_adding_a_task.py adds this line",
}
"""Lines of indented blocks that are no calls of our programs: a pattern of the first line, and why it is not run."""


PROGRAMS_OF_TRAINING = (bc.PROGRAM, centering.PROGRAM, latent.PROGRAM)


def run(path: str, **names: object) -> dict[str, object]:
    """Run the Python of a page from top to bottom in one namespace, and return it."""
    for block in python_of(path):
        exec(block, names)
    return names


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder that pages are read in: ``data/centering`` and ``data/block_picking``."""
    monkeypatch.chdir(tmp_path)
    dataset = Dataset.create_or_resume(tmp_path / "data" / "centering", "centering", 0, {})
    for index in range(4):
        write_episode(make_episode(index), dataset.episode_path(index))
    demonstrations(tmp_path / "data" / "block_picking", count=50, size=76)
    return tmp_path


RUN: dict[str, Callable[[Path], None]] = {}
"""What runs the Python of a page and looks at the result, by page."""


def page(path: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    def add(function: Callable[[Path], None]) -> Callable[[Path], None]:
        RUN[path] = function
        return function

    return add


@page("README.md")
def front_page(folder):
    assert run("README.md")["window"].shape == (64, 6)


@page("data/README.md")
def episode_file(folder):
    fields = run("data/README.md")["FIELDS"]
    assert {field.path for field in fields} > {"actions/action", "streams/left_finger/wrench"}


@page("docs/cloning.md")
def cloning(folder):
    names = run("docs/cloning.md")
    assert len(names["batch"]["reward"]) == 64
    assert names["buffer"].sample(2)["cameras/front/color"].shape[:2] == (2, 2)


@page("docs/tasks.md")
def tasks(folder):
    names = run("docs/tasks.md")
    assert {key: part.shape for key, part in names["observation"].items()} == {
        "image": (4, 76, 76), "wrench": (64, 6), "proprio": (5,),
    }  # fmt: skip
    names["env"].close()


@page("docs/simulation.md")
def simulation(folder):
    episode = make_episode()
    camera = episode.cameras["front"]
    calibration = Calibration(camera.intrinsics, camera.T_base_camera, camera.image_axes, float(camera.depth_scale))
    frame = Frame(camera.color[0], camera.depth[0])
    seen = run(
        "docs/simulation.md", episode=episode, frame=frame, calibration=calibration, workspace=episode.workspace
    )["seen"]
    assert len(seen.color) == len(episode.t_ns)


@page("docs/apriltags.md")
def apriltags(folder):
    half = 0.025
    with World(SMALL) as world:
        world.reset(seed=0)
        cube = world.add_box((half, half, half), (0.6, 0.1, half), 0.0, 0.1, 0.5)
        body, layout = wear_tags(world.client, cube, half)
        layout.write(folder / "block.json")
        camera = SimulatedTagCamera(world, replace(TAG_CAMERAS["tags_right_back"], height=480, width=640))
        names = run(
            "docs/apriltags.md", camera=camera, record=record, robot=world,
            policy=lambda observation: np.array([1.0, 0, 0, 0, 0], np.float32),
        )  # fmt: skip
        truth = pybullet.getBasePositionAndOrientation(body, physicsClientId=world.client)[0]
    assert names["success"]
    assert np.hypot(names["x"] - truth[0], names["y"] - truth[1]) < 0.005


@page("docs/teleoperation.md")
def teleoperation(folder):
    class Port:
        pressed = 0.5

        def value(self):
            if self.pressed is None:
                raise OSError
            return self.pressed

    port = Port()
    pedal = run("docs/teleoperation.md")["Pedal"](port)
    assert pedal.read().tolist() == [1, 0, 0, -0.5, 0]
    port.pressed = 1.0
    assert pedal.read().tolist() == [0, 0, 0, -1, 0]
    port.pressed = None
    with pytest.raises(DeviceLostError, match="unplugged"):
        pedal.read()


@pytest.mark.parametrize("path", RUN)
def test_the_python_of_a_page_runs(path, folder):
    RUN[path](folder)


def test_every_page_with_python_is_run():
    assert {name(page) for page in PAGES if python_of(name(page))} == RUN.keys() | ELSEWHERE.keys()
    assert all((ROOT / test).exists() for test in ELSEWHERE.values())


def test_other_blocks_are_what_they_seem_to_be(tmp_path):
    """Entry points are of groups that are looked up, flowcharts are drawn whole, and there are no other languages."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    for block in (block for page in PAGES for block in blocks(page)):
        if block.language == "toml":
            assert tomllib.loads(block.text)["project"]["entry-points"].keys() <= groups.keys()
        elif block.language == "mermaid":
            _, labels, arrows = parsed(block.text)
            drawn = svg(block.text)
            assert drawn.count("<rect") == len(labels)
            assert drawn.count('class="head"') == len(arrows)
        elif block.language == "yaml":
            file = tmp_path / "run.yaml"
            file.write_text(block.text)
            program = next(one for one in PROGRAMS_OF_TRAINING if one.name == read_yaml(file)["program"])
            assert complete(program.settings, resolve(program.settings, file, program=program.name))
        else:
            assert block.language in ("", "python", "sh", "bash"), block


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_other_line_is_one_that_is_known(page):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    for block in blocks(page):
        if block.language == "sh" or not block.language:
            for line in whole(block):
                if line.startswith("make "):
                    assert line.split()[1] in targets, line
                elif line.startswith("{"):
                    assert json.loads(line)
                elif not line.startswith(PROGRAMS):
                    assert any(re.match(pattern, line) for pattern in NOT_RUN), f"{block.page}: {line}"


def whole(block) -> list[str]:
    """The lines that are commands of their own: the first one alone of a list or a piece of a program."""
    lines = command_lines(block)
    return lines[:1] if lines[0].endswith(("/", ":")) else lines
