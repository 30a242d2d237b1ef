"""What the documentation says is what the code does."""

import re
import shlex
from itertools import pairwise

import h5py
import numpy as np
import pytest

from collectors.recording.loop import record
from collectors.robots.playback import Playback
from svfl_data.checks import check_episode
from svfl_data.cli import main
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.live_cut import LiveCut
from svfl_data.schema.clocks import STALE_PERIODS
from svfl_data.schema.fields import markdown_table
from svfl_data.storage.store import read_episode, write_episode
from svfl_models.cli import build_parser as training_commands
from svfl_models.cloning.recorded_inputs import recorded_input
from svfl_models.networks.image_crops import crop_side
from tests.helpers.builders import make_episode
from tests.helpers.pages import PAGES, ROOT, name, python_of

COMMANDS = sorted(
    {
        command
        for page in [*PAGES, ROOT / "Makefile"]
        for command in re.findall(r"^\s*(?:\$\(BIN\)/)?(svfl-\w+ .*)$", page.read_text().replace("\\\n", " "), re.M)
    }
)


def test_the_table_of_fields_is_the_declaration():
    page = (ROOT / "data" / "README.md").read_text()
    table = page.split("-->\n")[1].split("<!-- end of fields")[0].strip()
    assert table == markdown_table()


def test_the_table_of_attributes_is_what_is_written(tmp_path):
    page = (ROOT / "data" / "README.md").read_text()
    table = page.split("## Attributes of the file")[1].split("## ")[0]
    write_episode(make_episode(), tmp_path / "e.hdf5")
    with h5py.File(tmp_path / "e.hdf5") as file:
        assert set(re.findall(r"^\| `(\w+)`", table, re.M)) == set(file.attrs)


def test_there_are_commands_to_check():
    assert len(COMMANDS) >= 3


@pytest.mark.parametrize("command", COMMANDS)
def test_documented_commands_parse(command):
    from collectors.cli import build_parser as collect
    from svfl_data.cli import build_parser as data
    from svfl_models.cli import build_parser as train

    program, *arguments = shlex.split(re.split(r" [|>] ", command)[0], comments=True)
    parsers = {"svfl-collect": collect, "svfl-data": data, "svfl-train": train}
    if {"--help", "--version"} & set(arguments):
        with pytest.raises(SystemExit, match="0"):
            parsers[program]().parse_args(arguments)
        return
    assert parsers[program]().parse_args(arguments)


def test_the_python_of_the_page_on_symmetry_runs(capsys):
    names: dict = {}
    for block in python_of("docs/symmetry.md"):
        exec(block, names)
    printed = [float(line) for line in capsys.readouterr().out.splitlines()]
    assert len(printed) == 2
    assert max(printed) < 1e-5


def test_the_page_on_recording_can_be_followed_to_the_letter(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in python_of("docs/recording.md"):
        exec(block, names)
    said = capsys.readouterr().out
    assert said.count("episode_000000.hdf5") == 2
    assert said.splitlines().count("True") == 1
    episode = read_episode(tmp_path / "data" / "mine" / "episode_000000.hdf5")
    by_contract = names["by_contract"].read(0)
    assert by_contract.arrays.keys() == episode.arrays.keys()
    assert [one for one in check_episode(by_contract) if one.severity == "error"] == []
    playback = Playback(episode)
    again = record(playback, playback.policy, len(episode))
    assert again.keys() == episode.arrays.keys()
    assert [path for path in again if not np.array_equal(again[path], episode.arrays[path])] == []
    command = next(one for one in COMMANDS if one.startswith("svfl-train bc --data data/mine --episodes 10"))
    words = training_commands().parse_args(shlex.split(command)[1:])
    reader = Dataset.open("data/mine").episode(0)
    for one in [recorded_input(one, reader, symmetric=True) for one in words.inputs]:
        assert one.kind != "image" or crop_side(min(one.size), words.image_size)
    assert [one for one in check_episode(episode) if one.severity == "error"] == []
    assert len(episode.wrench) > 200
    assert len(episode["streams/left_finger/wrench"]) > 200
    assert episode["streams/tactile/pressure"].shape[1:] == (2, 16, 16)
    assert episode.meta.instruction == "wipe the plate"
    batch = names["batch"]
    shapes = {
        "streams/wrench/wrench": (2, 64, 6), "streams/left_finger/wrench": (2, 64, 6),
        "streams/joints/velocity": (2, 10, 6), "streams/tactile/pressure": (2, 4, 2, 16, 16),
        "observations/tcp_velocity": (2, 3), "actions/action": (2, 1, 7),
        "cameras/front/color": (2, 1, 48, 64, 3), "cameras/front/depth": (2, 1, 48, 64),
        "cameras/wrist/color": (2, 1, 32, 32, 3),
    }  # fmt: skip
    assert {path: batch[path].shape for path in shapes} == shapes
    longest_ns = np.diff(episode["streams/joints/t_ns"]).max()  # on a busy machine the stream may have a break
    assert not batch["streams/joints/padding"].any() or longest_ns > STALE_PERIODS * 1e9 / 500
    inputs = names["samples"].inputs  # a policy acts from what it learned from
    recorded, lived = cut_steps(by_contract, inputs, [-1]), LiveCut(inputs)(names["wiper"].observe())
    assert {path: rows.shape for path, rows in lived.items()} == {path: rows.shape for path, rows in recorded.items()}
    transitions = names["transitions"]
    shapes |= {path: (2, 1, 32, 32, *shapes[path][4:]) for path in shapes if path.startswith("cameras/")}
    after = {f"next_{path}": shape for path, shape in shapes.items() if path != "actions/action"}
    for path, shape in (shapes | after | {"actions/action": (2, 7)}).items():
        assert transitions[path].shape == (8, *shape[1:]), path
    assert names["in_base"](np.diag([1.0, -1.0, -1.0]), np.arange(6.0)).tolist() == [0, -1, -2, 3, -4, -5]
    commands = re.findall(r"^    (svfl-.*)$", (ROOT / "docs" / "recording.md").read_text(), re.M)
    assert len(commands) >= 5
    for command in commands:  # one after the other, as they stand
        monkeypatch.setattr("sys.argv", shlex.split(command, comments=True))
        assert main() == 0, command
    assert Dataset.open("data/good").indices == [0]
    assert not Dataset.open("data/mine").read(0).meta.success


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text()):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_lists_and_tables_begin_after_an_empty_line(page):
    """Forges show them otherwise too, the site does not."""
    lines = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S).splitlines()
    for before, line in pairwise(lines):
        if line.startswith("|"):
            assert not before or before.startswith(("|", "#", "<!--")), line
        elif re.match(r"([-*]|\d+\.) ", line) and before and not before.startswith(("#", " ")):
            assert re.match(r"([-*]|\d+\.) ", before), line
