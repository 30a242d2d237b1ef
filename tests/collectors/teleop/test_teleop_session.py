"""A session: what a person tells becomes episodes, and whatever happens, nothing of them is lost."""

import json
import os
import signal
import subprocess

import numpy as np
import pytest

from collectors.sources.replay import replay
from collectors.tasks import task_class
from collectors.tasks.gripper import nearest_turn
from collectors.tasks.task import attempt_seed
from collectors.teleop.clock import Clock
from collectors.teleop.devices.device import Command, Device, DeviceLostError, reading
from collectors.teleop.devices.keyboard import Keyboard
from collectors.teleop.devices.script import InputLog, Script
from collectors.teleop.devices.sdl import pygame
from collectors.teleop.screen import NoScreen
from collectors.teleop.session import Session
from collectors.teleop.setting import ATTEMPT, Teleoperation
from collectors.teleop.window import Window
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from tests.helpers.collecting import command
from tests.helpers.collectors import SMALL
from tests.helpers.typist import wait_for

pytestmark = pytest.mark.slow

HEAD = {"format": "svfl-teleop-log", "version": 1, "device": "test"}
REST, DOWN = [1, 0, 0, 0, 0], [1, 0, 0, -1, 0]


@pytest.fixture(scope="module")
def what():
    opened = Teleoperation(0, "block_picking", SMALL)
    yield opened
    opened.opened.close()


@pytest.fixture
def dataset(what, tmp_path):
    return Dataset.create_or_resume(tmp_path / "mine", what.task, what.seed, what.config())


def run(dataset, what, device, screen=None, clock=None, max_steps=100, log=None, viewer=None) -> Dataset:
    screen, clock = screen or NoScreen(), clock or Clock(paced=False)
    screen.present(device)
    Session(dataset, what, device, screen, clock, 0.5, max_steps, {"operator": "ada"}, log, viewer).run()
    return dataset


def script(tmp_path, *lines: dict) -> Script:
    path = tmp_path / "script.log"
    path.write_text("\n".join(json.dumps(line) for line in (HEAD, *lines)))
    return Script(path)


def at(tick: int, told: list[float], *commands: str) -> dict:
    return {"tick": tick, "input": told, "commands": commands}


def ends(dataset: Dataset) -> dict[int, tuple[str, bool, int]]:
    return {
        episode.meta.index: (episode.meta.config["teleop"]["ended"], episode.meta.success, len(episode))
        for episode in dataset
    }


class Picker(Device):
    """Knows where the block is, and picks it; then it quits."""

    name = "picker"

    def __init__(self, what: Teleoperation):
        self.world = what.opened
        self.scene = task_class(what.task).begin(self.world, attempt_seed(what.seed, 0, ATTEMPT)).scene
        self.moves, self.told = self.pick(), [[Command.START], [Command.QUIT]]

    def begin(self, opened):
        self.now = self.told.pop(0)

    def commands(self):
        now, self.now = self.now, []
        return now

    def read(self):
        return next(self.moves)

    def pick(self):
        (x, y), theta = self.scene.xy, nearest_turn(self.scene.yaw, np.pi / 2)
        for height in (0.12, 0.02):
            while np.abs(gap := np.array([x, y, height, theta]) - self.world.target).max() > 0.003:
                toward = np.clip(gap / [0.025, 0.025, 0.025, 0.1], -1, 1)
                yield reading(1.0, toward[1], -toward[0], *toward[2:])  # the picture's right is y, its away is -x
        yield from [reading(0.0, 0, 0, 0, 0)] * 5
        while True:
            yield reading(0.0, 0, 0, 1, 0)


def test_commands_make_replace_and_throw_away_episodes(dataset, what, tmp_path):
    device = script(
        tmp_path, at(0, DOWN, "again"), at(3, REST, "start"), at(9, DOWN, "stop"),
        at(12, REST, "again"), at(13, REST, "start"), at(20, DOWN, "success"),
        at(22, REST, "start"), at(25, REST, "discard"), at(27, REST, "success", "start"), at(29, REST, "quit"),
    )  # fmt: skip
    run(dataset, what, device)
    assert ends(dataset) == {0: ("marked as success", True, 6), 1: ("quit", False, 1)}
    episode = dataset.read(0)
    assert (episode.meta.source, episode.meta.config["teleop"]["operator"]) == ("teleop", "ada")
    assert [check_episode(one) for one in dataset] == [[], []]
    assert all(replay(one).exact for one in dataset)
    assert not list((dataset.path / ".inflight").iterdir())


def test_an_achieved_task_ends_by_itself_and_its_log_gives_it_again(dataset, what, tmp_path):
    log = InputLog(tmp_path / "session.log", device="picker")
    run(dataset, what, Picker(what), log=log)
    log.close()
    assert ends(dataset)[0][:2] == ("achieved", True)
    assert replay(dataset.read(0)).exact
    again = Dataset.create_or_resume(tmp_path / "again", what.task, what.seed, what.config())
    run(again, what, Script(tmp_path / "session.log"))
    for path, values in dataset.read(0).arrays.items():
        assert values.tobytes() == again.read(0).arrays[path].tobytes(), path


def test_the_last_tare_is_the_one_of_the_whole_episode(dataset, what, tmp_path):
    run(dataset, what, script(tmp_path, at(0, REST, "start"), at(4, REST, "tare"), at(6, DOWN, "stop")))
    episode = dataset.read(0)
    (when,) = episode.meta.config["teleop"]["tares_ns"]
    before = episode.wrench[episode.wrench_t_ns <= when]
    assert episode.tare == pytest.approx(before[-what.world.tare_readings :].mean(axis=0), abs=1e-4)
    assert not replay(episode).exact  # whose tare is that of the beginning


class Reader(NoScreen):
    """Reads what the screen says."""

    def __init__(self):
        self.views = []

    def show(self, view):
        self.views.append(view)


def test_a_tare_in_contact_is_said_to_be_one(dataset, what, tmp_path):
    screen = Reader()
    told = at(0, REST, "start"), at(2, REST, "tare"), at(4, DOWN), at(46, DOWN, "tare"), at(48, DOWN, "stop")
    run(dataset, what, script(tmp_path, *told), screen)
    said = [view.message for view in screen.views if view.message.startswith("tared")]
    assert "in contact" not in said[0]
    assert "in contact, so again when the gripper is free" in said[-1]


class Audience(dict):
    """A viewer that remembers the times of what it is shown of each episode, and of the latest readings."""

    def __call__(self, robot, seen, action, readings):
        self.setdefault(self.name, []).append((seen.t_ns, int(readings["streams/wrench"]["t_ns"][-1])))


def test_a_viewer_is_shown_every_episode_and_changes_none(dataset, what, tmp_path, monkeypatch):
    audience, blind = Audience(), Dataset.create_or_resume(tmp_path / "blind", what.task, what.seed, what.config())
    monkeypatch.setattr("collectors.recording.live_view.viewer", {"here:1": audience}.__getitem__)
    lines = at(0, DOWN, "start"), at(4, REST, "stop"), at(6, DOWN, "start"), at(9, REST, "discard")
    run(dataset, what, script(tmp_path, *lines), viewer="here:1")
    run(blind, what, script(tmp_path, *lines))
    steps_ns = dataset.read(0).t_ns.tolist()
    both = [(t_ns, t_ns) for t_ns in steps_ns]
    assert audience == {"episode 0": both, "episode 1": both[:3]}
    assert dataset.episode(0).seal == blind.episode(0).seal


class Feeling(Script):
    """Remembers how it was told that an episode begins, and what it let the person feel."""

    def __init__(self, script: Script):
        self.__dict__ |= script.__dict__
        self.began, self.felt = [], []

    def begin(self, opened):
        self.began.append(opened)

    def touch(self, newtons):
        self.felt.append(newtons)


def test_a_contact_is_felt_once(dataset, what, tmp_path):
    device = Feeling(script(tmp_path, at(0, DOWN, "start"), at(30, DOWN, "stop")))
    run(dataset, what, device)
    assert len(device.felt) == 1  # the gripper comes down on the table, and presses on
    assert device.felt[0] > 5
    assert device.began == [True, True]


def test_a_gripper_that_begins_with_something_stays_closed(what, tmp_path):
    pegs = Teleoperation(0, "peg_insertion", SMALL)
    pegs.__dict__["opened"] = what.opened
    device = Feeling(script(tmp_path, at(0, REST, "quit")))
    run(Dataset.create_or_resume(tmp_path / "pegs", pegs.task, 0, pegs.config()), pegs, device)
    assert device.began == [False]


def test_time_is_limited(dataset, what, tmp_path):
    run(dataset, what, script(tmp_path, at(0, DOWN, "start"), at(20, REST)), max_steps=7)
    assert ends(dataset) == {0: ("time was up", False, 7)}


class Breaking(Script):
    """Does something bad at a tick."""

    def __init__(self, script: Script, tick: int, bad):
        self.__dict__ |= script.__dict__
        self.left, self.bad = tick, bad

    def read(self):
        self.left -= 1
        if self.left == 0:
            self.bad()
        return super().read()


def unplug():
    raise DeviceLostError("the toy was unplugged")


@pytest.mark.parametrize(
    ("bad", "error", "end"),
    [(unplug, DeviceLostError, "device lost"),
     (lambda: os.kill(os.getpid(), signal.SIGTERM), KeyboardInterrupt, "interrupted"),
     (lambda: os.kill(os.getpid(), signal.SIGINT), KeyboardInterrupt, "interrupted")],
)  # fmt: skip
def test_what_breaks_in_the_middle_leaves_a_partial_episode(dataset, what, tmp_path, bad, error, end):
    with pytest.raises(error):
        run(dataset, what, Breaking(script(tmp_path, at(0, DOWN, "start"), at(50, REST)), 8, bad))
    assert ends(dataset) == {0: (end, False, 6)}
    assert check_episode(dataset.read(0)) == []


def test_a_killed_session_is_salvaged_by_the_next(what, tmp_path):
    script(tmp_path, at(0, [1, 0, 0, -0.02, 0], "start"), at(10**6, REST))
    out = tmp_path / "mine"
    words = ("--task", what.task, "--input-device", "script", tmp_path / "script.log", "--image-size", 16, "--out", out)
    process = subprocess.Popen(command("teleop", *words, "--seconds", 3600), stderr=subprocess.PIPE)
    journal = out / ".inflight" / "episode_000000.journal"
    wait_for(lambda: journal.exists() and journal.stat().st_size > 200_000, process)
    process.kill()
    process.communicate()
    dataset = Dataset.open(out)
    run(dataset, what, script(tmp_path, at(0, DOWN, "start"), at(3, REST, "stop")))
    killed, after = dataset
    assert not killed.meta.success
    assert killed.meta.history[-1]["salvaged"]
    assert killed.has("object_pose")
    assert len(killed) > 10
    assert len(killed.t_ns) == len(killed) + 1
    assert (after.meta.index, len(after)) == (1, 2)


def test_a_salvaged_episode_is_the_recorded_one(what, tmp_path):
    """The journal of an episode that was not saved, against the same episode saved: every array is the same."""
    lines = at(0, DOWN, "start"), at(12, REST, "stop"), at(14, REST, "quit")
    saved, lost = (
        Dataset.create_or_resume(tmp_path / name, what.task, what.seed, what.config()) for name in ("saved", "lost")
    )
    run(saved, what, script(tmp_path, *lines))

    def die():
        raise RuntimeError

    with pytest.raises(RuntimeError):
        run(lost, what, Breaking(script(tmp_path, *lines), 13, die))
    run(lost, what, script(tmp_path, at(0, REST, "quit")))
    assert lost.read(0).arrays.keys() == saved.read(0).arrays.keys()
    for path, values in saved.read(0).arrays.items():
        assert values.tobytes() == lost.read(0).arrays[path].tobytes(), path


class Typing(Clock):
    """Puts events into the window's queue, some for each beat."""

    def __init__(self, *events):
        super().__init__()
        self.events = list(events)

    def wait(self):
        for event in self.events.pop(0) if self.events else ():
            pygame.event.post(event)
        super().wait()


def key(kind: int, scancode: int, key: int = 0) -> pygame.event.Event:
    return pygame.event.Event(kind, scancode=scancode, key=key)


def test_closing_the_window_keeps_the_episode(dataset, what, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window()
    enter = key(pygame.KEYDOWN, pygame.KSCAN_RETURN, pygame.K_RETURN)
    clock = Typing(
        [enter], [key(pygame.KEYDOWN, pygame.KSCAN_D)], [key(pygame.KEYUP, pygame.KSCAN_D)], [], [],
        [pygame.event.Event(pygame.QUIT)],
    )  # fmt: skip
    try:
        run(dataset, what, Keyboard(), window, clock)
        picture = pygame.surfarray.array3d(pygame.display.get_surface())
    finally:
        window.close()
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50  # something is drawn
    episode = dataset.read(0)
    assert ends(dataset) == {0: ("quit", False, 4)}
    assert episode.action[:, 2].tolist() == pytest.approx([0.025 / 3, 0, 0, 0])  # a tap: one soft tick to the right
    beats = episode.arrays["extra/teleop/beat_ns"]
    assert (beats.shape, (np.diff(beats) > 0).all()) == ((4,), True)
    assert episode.meta.config["teleop"]["jitter_ms"].keys() == {"median", "p99", "max"}


@pytest.mark.parametrize(
    ("scancode", "letter", "tells"),
    [
        (pygame.KSCAN_X, "x", [Command.STOP]),
        (pygame.KSCAN_SEMICOLON, "m", [Command.SUCCESS]),  # French: where it is printed, not where others have it
        (pygame.KSCAN_M, ",", []),
        (pygame.KSCAN_T, "è", []),  # Bépo
        (pygame.KSCAN_X, "ч", [Command.STOP]),  # Russian
        (pygame.KSCAN_R, "ρ", [Command.AGAIN]),  # Greek
        (pygame.KSCAN_W, "ц", []),
    ],
)
def test_keys_tell_the_same_on_every_layout(monkeypatch, scancode, letter, tells):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window()
    try:
        pygame.event.clear()
        pygame.event.post(key(pygame.KEYDOWN, scancode, ord(letter)))
        assert window.poll()[1] == tells
    finally:
        window.close()
