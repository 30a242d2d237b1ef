"""A robot that another package adds: a person and a policy move it, and it is seen while they do."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from collectors import cli
from collectors.recording.live_view import shown, viewer
from collectors.recording.loop import record
from collectors.robots import GROUP, connected, is_simulated, make
from collectors.robots.playback import Playback
from collectors.simulation import WorldConfig
from collectors.sources import policy
from collectors.sources.replay import from_json
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, UsageError
from tests.helpers.command_page import item_keys
from tests.helpers.finger_robot import FingerRobot
from tests.helpers.own_robot import own_episode
from tests.helpers.rerun_files import entities, gathered

PACKAGE = """
import numpy as np
from tests.helpers.finger_robot import FingerRobot

robots = []

def finger():
    robots.append(FingerRobot())
    return robots[-1]

def load(path):
    def policy(seen):
        down = seen.at("streams/left_finger/wrench")[-1, 2]
        return None if seen.t_ns > 1_000_000_000 else np.array([0, 9, -0.001 * down, 0, 0, 0, 1], np.float32)
    return policy

def short(path):
    return lambda seen: np.zeros(5, np.float32)

nothing = None

class Half:  # not all of the contract
    name, rate_hz = "half_arm", 20.0
    def connect(self): pass
    def observe(self): pass

class Silent(FingerRobot):  # nobody knows how often it takes a step
    rate_hz = property()
"""
FINGER = ("policy", "--task", "x", "--robot", "finger_arm", "--checkpoint")
DOWN, REST = [1, 0, 0, -1, 0], [0.5, 1, 0, 0, 1]


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package beside this one that adds a robot and two kinds of policies; it knows the robots that were made."""
    (tmp_path / "finger_package.py").write_text(PACKAGE)
    info = tmp_path / "finger_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: finger-package\nVersion: 1.0\n")
    entries = f"[{GROUP}]\nfinger_arm = finger_package:finger\nno_arm = finger_package:nothing\n"
    entries += "half_arm = finger_package:Half\nsilent_arm = finger_package:Silent\n"
    entries += f"[{policy.GROUP}]\nfixed = finger_package:load\nshort = finger_package:short\n"
    (info / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(tmp_path)
    import finger_package

    finger_package.robots.clear()
    return finger_package


@pytest.fixture
def run(monkeypatch, capsys):
    """Runs ``svfl-collect``, and returns its exit code, its output and its complaints."""

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["svfl-collect", *map(str, words)])
        try:
            code = cli.main()
        except SystemExit as error:
            code = int(str(error))
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def script(path: Path, *lines: tuple[int, list[float], list[str]]) -> Path:
    head = {"format": "svfl-teleop-log", "version": 1, "device": "test"}
    rows = [{"tick": tick, "input": told, "commands": commands} for tick, told, commands in lines]
    path.write_text("\n".join(json.dumps(line) for line in (head, *rows)))
    return path


def test_a_person_moves_it(package, tmp_path, run):
    log = script(
        tmp_path / "mine.log", (0, DOWN, ["start"]), (3, REST, ["tare"]), (6, REST, ["success"]),
        (8, DOWN, ["start"]), (10, DOWN, ["discard"]), (12, DOWN, ["start"]), (15, DOWN, ["quit"]),
    )  # fmt: skip
    out = tmp_path / "mine"
    words = ("teleop", "--task", "wiping", "--robot", "finger_arm", "--input-device", "script", log, "--out", out)
    code, said, err = run(*words, "--pace", 1)
    assert (code, err) == (0, "")
    code, as_json, err = run(*words[:-1], tmp_path / "again", "--json")
    (told,) = json.loads(as_json)["datasets"]
    assert told.keys() == item_keys("svfl-collect teleop")
    assert (told["episodes"], told["successes"], told["collected"]) == (2, 1, 2)
    assert "episode 0 saved" in err
    package.robots.pop()
    assert "episode 0 saved: success (marked as success), 5 steps, 0.5 s" in said
    dataset = Dataset.open(out)
    first, second = dataset.read(0), dataset.read(1)
    assert (first.meta.success, first.meta.robot, first.meta.task) == (True, "finger_arm", "wiping")
    assert (second.meta.success, len(second)) == (False, 2)
    np.testing.assert_allclose(first.action[:2, 2], [-0.02 / 3, -0.04 / 3], rtol=1e-5)  # a soft start
    np.testing.assert_allclose(first.action[-1, [5, 6]], [0.05, 0.5], rtol=1e-5)  # turns about z at half the pace
    assert first["streams/tactile/pressure"].shape[1:] == (2, 6, 6)
    assert first.declarations.at("streams/left_finger/wrench").axes == "sensor"
    past = first["streams/left_finger/t_ns"] <= first.meta.config["teleop"]["tares_ns"][0]
    tare = first["streams/left_finger/wrench"][past].mean(axis=0, dtype=np.float64)
    np.testing.assert_allclose(first["streams/left_finger/tare"], tare, rtol=1e-12)
    (robot,) = package.robots
    assert robot.calls[0] == "connect"
    assert robot.calls[-2:] == ["stop", "close"]
    assert robot.calls.count("home") == 3


def test_a_policy_moves_it(package, tmp_path, run):
    (tmp_path / "down.fixed").touch()
    words = ("policy", "--task", "wiping", "--robot", "finger_arm", "--checkpoint", tmp_path / "down.fixed")
    code, said, _ = run(*words, "--episodes", 2, "--out", tmp_path / "two")
    assert code == 0
    assert "2 episodes; mark those that succeeded with: svfl-data relabel" in said
    for episode in Dataset.open(tmp_path / "two"):
        assert (episode.meta.source, episode.meta.success, len(episode)) == ("policy", False, 6)
        assert (episode.action[:, 1] == np.float32(0.02)).all()  # within its bounds
        felt = episode["streams/left_finger/wrench"] - episode["streams/left_finger/tare"]
        rows = np.searchsorted(episode["streams/left_finger/t_ns"], episode.t_ns[:-1], side="right") - 1
        np.testing.assert_allclose(episode.action[:, 2], -0.001 * felt[rows, 2], atol=1e-7)
    code, said, _ = run(*words, "--episodes", 1, "--max-steps", 3, "--out", tmp_path / "short", "--json")
    (told,) = json.loads(said)["datasets"]
    assert told == {"path": str(tmp_path / "short"), "task": "wiping", "episodes": 1, "collected": 1}
    assert (code, len(Dataset.open(tmp_path / "short").read(0))) == (0, 3)
    assert all(robot.calls[-1] == "close" for robot in package.robots)


@pytest.mark.parametrize(
    ("code", "facts", "words"),
    [
        (2, "robot finger_arm is not simulated, which this needs; simulated are panda_sim, ur5e_sim",
         ("expert", "--task", "block_picking", "--robot", "finger_arm", "--out", "OUT")),
        (2, "robot finger_arm is not simulated", ("centering", "--robot", "finger_arm", "--out", "OUT")),
        (2, "--image-size is for simulated robots, and robot finger_arm is not",
         (*FINGER, "a.fixed", "--image-size", 20, "--out", "OUT")),
        (2, "one worker of this machine",
         (*FINGER, "a.fixed", "--workers", 2, "--out", "OUT")),
        (2, "--max-steps is for robots that are not simulated",
         ("policy", "--task", "block_picking", "--checkpoint", "a.fixed", "--max-steps", 9, "--out", "OUT")),
        (2, "no task 'wiping'; possible are block_picking",
         ("policy", "--task", "wiping", "--checkpoint", "a.fixed", "--out", "OUT")),
        (2, "no robot 'abacus'; possible are finger_arm, half_arm, no_arm, panda_sim, silent_arm, ur5e_sim",
         ("policy", "--task", "x", "--robot", "abacus", "--checkpoint", "a.fixed", "--out", "OUT")),
        (2, "robot no_arm: finger_package:nothing cannot be loaded",
         ("policy", "--task", "x", "--robot", "no_arm", "--checkpoint", "a.fixed", "--out", "OUT")),
        (1, "gives an action of shape (5,); robot finger_arm takes 7 numbers (dx, dy, dz, rx, ry, rz, opening)",
         (*FINGER, "a.short", "--out", "OUT")),
    ],
)  # fmt: skip
def test_what_it_cannot_do_is_one_line(package, tmp_path, run, monkeypatch, code, facts, words):
    monkeypatch.chdir(tmp_path)
    for kind in ("fixed", "short"):
        Path(f"a.{kind}").touch()
    found, _, err = run(*words)
    assert found == code
    assert facts in err
    assert err.count("\n") == 1


def test_a_robot_is_simulated_or_not(package):
    assert (is_simulated("ur5e_sim"), is_simulated("finger_arm")) == (True, False)
    assert connected("finger_arm").name == "finger_arm"
    with pytest.raises(UsageError, match="panda_sim is simulated"):
        connected("panda_sim")
    with pytest.raises(UsageError, match="not simulated"):
        make("finger_arm")
    with pytest.raises(FormatError, match=r"config\.world: .*finger_arm is not simulated"):  # a file that names it
        from_json(WorldConfig, {"robot": {"name": "finger_arm"}}, "config.world")


@pytest.mark.parametrize(
    ("name", "lacking"),
    [("half_arm", "home, tare, readings, step, stop, close, constants"), ("silent_arm", "rate_hz")],
)
def test_what_is_no_robot_is_said_to_be_none(package, name, lacking):
    with pytest.raises(UsageError, match=rf"robot {name}: finger_package:\w+ has no {lacking}, which every"):
        connected(name)


@pytest.mark.parametrize("robot", [FingerRobot, lambda: Playback(own_episode(0))], ids=["own", "record"])
def test_its_own_streams_are_shown_live(monkeypatch, tmp_path, robot):
    rr = pytest.importorskip("rerun")
    file, made = tmp_path / "live.rrd", robot()
    monkeypatch.setattr("socket.create_connection", lambda *_, **__: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda self, url: self.save(file))
    viewer.cache_clear()
    action = np.array([0.01, 0, 0, 0, 0, 0.1, 1], np.float32)
    with shown("here:1", 0) as live:
        arrays = record(made, lambda _: action, 4, watch=live)
    live.close()
    viewer.cache_clear()
    there = entities(file)
    for path in (
        "actions/action",
        "streams/left_finger/wrench",
        "streams/tactile/pressure",
        "observations/tcp_velocity",
    ):
        assert any(name.startswith(f"/fields/{path}") for name in there), path
    t_ns, force = map(np.array, gathered(file, "wrench/force", "Scalars:scalars"))
    begin_ns = t_ns[~np.isnan(force).any(axis=1)][0] - arrays["streams/wrench/t_ns"][0]
    tared = arrays["streams/wrench/wrench"][:, :3] - arrays["streams/wrench/tare"][:3]
    np.testing.assert_allclose(force[~np.isnan(force).any(axis=1)], tared, atol=1e-5)
    moved = [name for name in there if name.startswith("/fields/actions/action")]
    assert len(moved) == 3  # metres, radians and the opening have a plot each
    at_ns, _ = gathered(file, min(moved)[1:], "Scalars:scalars")
    assert at_ns[1:].tolist() == (arrays["observations/t_ns"][:-1] + begin_ns).tolist()
    cameras = {name.split("/")[-2] for name in there if name.endswith("/color")}
    assert cameras == {path.split("/")[1] for path in arrays if path.endswith("/color")}
