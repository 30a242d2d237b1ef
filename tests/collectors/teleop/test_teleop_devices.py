"""What devices make of keys, sticks and reports, and what the mapper makes of that."""

import ctypes
import re
import struct
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from collectors.simulation.camera import CAMERAS, calibration
from collectors.teleop.action_mapper import RAMP, TURN, ActionMapper
from collectors.teleop.clock import PERIOD_NS, Clock, steadiness
from collectors.teleop.devices.device import FINE, Command, DeviceLostError, reading, without_rest
from collectors.teleop.devices.gamepad import Gamepad
from collectors.teleop.devices.keyboard import Keyboard
from collectors.teleop.devices.script import InputLog, Script
from collectors.teleop.devices.sdl import pygame
from collectors.teleop.devices.spacemouse import SpaceMouse, is_spacemouse
from collectors.teleop.panel import SIZE, Panel
from collectors.teleop.view import View, in_contact, pixel
from svfl_data.errors import CollectError, FormatError, UsageError
from svfl_data.schema.action_fields import joint_action, planar_action, pose_action
from svfl_data.schema.observation import Observation
from tests.helpers.finger_robot import WORKSPACE, FingerRobot

BOUND = np.array([0.025, 0.025, 0.025, np.pi / 16])
ACTION = planar_action()
FRONT = calibration(CAMERAS["front"])
readings = arrays(np.float32, 5, elements=st.floats(-1, 1, width=32))


def down(scancode: int) -> pygame.event.Event:
    return pygame.event.Event(pygame.KEYDOWN, scancode=scancode)


def up(scancode: int) -> pygame.event.Event:
    return pygame.event.Event(pygame.KEYUP, scancode=scancode)


def told(keyboard: Keyboard, *events: pygame.event.Event) -> list[float]:
    for event in events:
        keyboard.handle(event)
    return keyboard.read().tolist()


def test_held_keys_move_until_they_are_released():
    keyboard = Keyboard()
    assert told(keyboard, down(pygame.KSCAN_D), down(pygame.KSCAN_W), down(pygame.KSCAN_LEFT)) == [1, 1, 1, 0, 1]
    assert told(keyboard) == [1, 1, 1, 0, 1]
    assert told(keyboard, down(pygame.KSCAN_LSHIFT)) == [1, FINE, FINE, 0, FINE]
    assert told(keyboard, up(pygame.KSCAN_D), down(pygame.KSCAN_S)) == [1, 0, 0, 0, FINE]  # W and S: neither
    assert told(keyboard, pygame.event.Event(pygame.WINDOWFOCUSLOST)) == [1, 0, 0, 0, 0]


def test_a_tap_between_two_actions_moves_for_one():
    keyboard = Keyboard()
    assert told(keyboard, down(pygame.KSCAN_Q), up(pygame.KSCAN_Q)) == [1, 0, 0, -1, 0]
    assert told(keyboard) == [1, 0, 0, 0, 0]


def test_space_opens_and_closes():
    keyboard = Keyboard()
    assert told(keyboard, down(pygame.KSCAN_SPACE), up(pygame.KSCAN_SPACE))[0] == 0
    assert told(keyboard, down(pygame.KSCAN_SPACE))[0] == 1
    keyboard.begin(opened=False)
    assert told(keyboard)[0] == 0


def test_the_pilot_moves_as_the_picture_shows():
    """Away is -x and right is +y for the front camera, which looks back at the robot."""
    assert ActionMapper(ACTION, FRONT.image_axes, 0.2).action(np.array([1, 1, 0, 0, 0], np.float32)) == pytest.approx(
        [1, 0, 0.2 * 0.025, 0, 0], abs=1e-9
    )
    assert ActionMapper(ACTION, FRONT.image_axes, 0.2).action(np.array([0, 0, 1, -1, 1], np.float32)) == pytest.approx(
        [0, -0.2 * 0.025, 0, -0.2 * 0.025, 0.2 * TURN * np.pi / 16], abs=1e-9
    )


def test_other_actions_are_commanded_by_the_names_of_their_components():
    told = np.array([0.25, 1, 0, -1, 1], np.float32)
    pose = ActionMapper(pose_action(0.03, 0.2), np.eye(2), 1.0)
    for _ in range(3):
        action = pose.action(told)
    assert action == pytest.approx([0.03, 0, -0.03, 0, 0, TURN * 0.2, 0.25], abs=1e-6)
    with pytest.raises(UsageError, match="displacements dx, dy, dz of the gripper; the action of this robot is j0, j1"):
        ActionMapper(joint_action([(-1, 1)] * 2, ["j0", "j1"]), np.eye(2), 1.0)
    absolute = replace(pose_action(0.03, 0.2), delta=(False,) * 7)
    with pytest.raises(UsageError, match="displacements"):
        ActionMapper(absolute, np.eye(2), 1.0)


NOTHING = View(
    task="wiping", observation=Observation(0), camera=None, calibration=None, workspace=None, wrench=None,
    contact=False, episode=0, seconds=None, saved=0, succeeded=0, message="", pace="",
)  # fmt: skip


@pytest.mark.parametrize("moment", ["at rest", "recording"])
def test_a_screen_draws_what_the_robot_has(moment):
    """Nothing, a picture that nobody can place, or everything but proprioception: each adds to what is drawn."""
    robot = FingerRobot()
    seen, panel = robot.observe(), Panel("keyboard", [])
    nothing = replace(NOTHING, seconds=None if moment == "at rest" else 1.0)
    picture = replace(nothing, observation=seen, camera="eye")
    whole = replace(picture, calibration=robot.cameras["eye"], workspace=WORKSPACE, wrench=np.full(6, 3.0))
    drawn = []
    for view in (nothing, picture, whole):
        target = pygame.Surface(SIZE)
        panel.draw(target, view)
        drawn.append(pygame.surfarray.array3d(target))
    for less, more in pairwise(drawn):
        assert (less != more).any(axis=2).sum() > 500


@given(st.lists(readings, min_size=1, max_size=12), st.floats(0.05, 1), st.sampled_from([*CAMERAS]))
def test_actions_stay_in_their_bounds_and_change_softly(ticks, pace, camera):
    mapper = ActionMapper(ACTION, calibration(CAMERAS[camera]).image_axes, pace)
    last = np.zeros(4)
    for told in ticks:
        action = mapper.action(told)
        assert action.dtype == np.float32
        assert 0 <= action[0] <= 1
        assert (np.abs(action[1:]) <= pace * BOUND * [1, 1, 1, TURN] * (1 + 1e-6)).all()
        assert (np.abs(action[1:] - last) <= RAMP * BOUND * (1 + 1e-6)).all()
        last = action[1:]


@given(st.lists(st.tuples(readings, st.lists(st.sampled_from(Command), max_size=2)), max_size=12))
def test_a_script_tells_what_was_logged(tmp_path_factory, ticks):
    path = tmp_path_factory.mktemp("log") / "session.log"
    log = InputLog(path, device="keyboard")
    for told, commands in ticks:
        log.append(reading(*told), commands)
    log.close()
    script = Script(path)
    for told, commands in ticks:
        assert script.read().tobytes() == reading(*told).tobytes()
        assert script.commands() == commands
    for _ in range(2):
        script.read()
        assert script.commands() == [Command.QUIT]


HEAD = '{"format": "svfl-teleop-log", "version": 1}\n'


@pytest.mark.parametrize(
    "text",
    ["", "tick 0\n", "[]", '{"format": "other", "version": 1}', HEAD + '{"input": [1, 0, 0, 0, 0]}',
     HEAD + '{"tick": 0, "input": [1, 0]}', HEAD + '{"tick": 0, "commands": ["jump"]}'],
)  # fmt: skip
def test_what_is_no_log_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "notes.txt").write_text(text)
    with pytest.raises(FormatError, match=r"notes\.txt") as caught:
        Script(tmp_path / "notes.txt")
    assert "\n" not in str(caught.value)


class Hid:
    """A HID device with reports to give; an exception among them is raised."""

    def __init__(self, *reports):
        self.reports = list(reports)

    def read(self, size):
        report = self.reports.pop(0) if self.reports else b""
        if isinstance(report, Exception):
            raise report
        return list(report)


def report(kind: int, *values: int) -> bytes:
    return bytes([kind]) + struct.pack(f"<{len(values)}h", *values)


def test_a_spacemouse_moves_the_gripper_as_its_cap():
    """Reports in its axes: right, near, down; one device in two reports, another in one."""
    old = SpaceMouse(Hid(report(1, 350, 0, 0), report(2, 0, 0, -350)))
    assert old.read().tolist() == [1, 1, 0, 0, 1]
    new = SpaceMouse(Hid(report(1, 0, -350, 500, 0, 0, 350)))
    assert new.read().tolist() == [1, 0, 1, -1, -1]
    assert new.read().tolist() == [1, 0, 1, -1, -1]  # held


def test_a_spacemouse_button_counts_once_for_each_press():
    mouse = SpaceMouse(Hid(b"\3\1\0", b"\3\1\0", b"\3\0\0"))
    assert mouse.read()[0] == 0
    with pytest.raises(DeviceLostError):
        SpaceMouse(Hid(OSError("read error"))).read()


@pytest.mark.parametrize(
    ("vendor", "name", "is_one"),
    [(0x256F, "SpaceMouse Compact", True), (0x256F, "3Dconnexion Universal Receiver", True),
     (0x046D, "SpaceNavigator", True), (0x256F, "CadMouse Pro", False), (0x046D, "USB Receiver", False),
     (0x1234, "SpaceMouse", False), (0x256F, None, False)],
)  # fmt: skip
def test_which_hid_devices_are_spacemice(vendor, name, is_one):
    assert is_spacemouse({"vendor_id": vendor, "product_string": name}) == is_one


def test_without_a_spacemouse_the_devices_are_named(monkeypatch):
    import hid

    monkeypatch.setattr(hid, "enumerate", lambda: [{"vendor_id": 1, "product_string": "Abacus"}])
    with pytest.raises(CollectError, match="found Abacus"):
        SpaceMouse.find()


@pytest.fixture
def sdl(monkeypatch):
    """SDL itself, with a window nobody sees: it can pretend that a gamepad is plugged in."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    pygame.display.set_mode((8, 8))
    maps = Path("/proc/self/maps")
    lines = maps.read_text().splitlines() if maps.exists() else []
    library = next((line.split()[-1] for line in lines if "libSDL2-2" in line), None)
    if library is None:
        pytest.skip("the SDL library that pygame loaded was not found")
    yield ctypes.CDLL(library)
    pygame.joystick.quit()
    pygame.display.quit()


def test_a_gamepad_steers_tells_and_is_lost(sdl):
    with pytest.raises(CollectError, match=r"gamepad.* found no joystick"):
        Gamepad()
    number = sdl.SDL_JoystickAttachVirtual(1, 6, 15, 0)
    sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
    pad, joystick = Gamepad(), ctypes.c_void_p(sdl.SDL_JoystickOpen(number))

    def put(*axes: float) -> list[float]:
        for axis, value in enumerate(axes):
            sdl.SDL_JoystickSetVirtualAxis(joystick, axis, ctypes.c_int16(round(32767 * value)))
        pygame.event.pump()
        return pad.read().tolist()

    # Left stick, right stick, triggers; SDL's sticks point down.
    assert put(0, 0, 0, 0, -1, -1) == [1, 0, 0, 0, 0]
    assert put(1, -1, 0, 0, -1, 1) == pytest.approx([1, 1, 1, 1, 0], abs=1e-3)
    assert put(0.1, 0, -1, 0, 1, -1) == pytest.approx([1, 0, 0, -1, 1], abs=1e-3)
    pygame.event.clear()
    for button in (0, 6):  # A, start
        sdl.SDL_JoystickSetVirtualButton(joystick, button, 1)
    for event in pygame.event.get():
        pad.handle(event)
    assert pad.read()[0] == 0
    assert (pad.commands(), pad.commands()) == ([Command.START], [])
    pad.touch(10.0)
    sdl.SDL_JoystickDetachVirtual(number)
    pygame.event.pump()
    with pytest.raises(DeviceLostError):
        pad.read()
    pad.close()


@given(st.floats(-1, 1), st.floats(0, 0.5))
def test_a_stick_has_a_zone_of_rest_and_no_jump_behind_it(value, zone):
    assert without_rest(value, zone) == pytest.approx(-without_rest(-value, zone))
    assert abs(without_rest(value, zone)) <= abs(value) + 1e-12
    assert without_rest(1.0, zone) == 1.0
    assert without_rest(zone, zone) == 0.0


def test_the_beat_goes_on_after_a_delay_without_a_burst(monkeypatch):
    now = [7 * PERIOD_NS]

    def sleep(seconds: float) -> None:
        now[0] += round(seconds * 1e9)

    fake = SimpleNamespace(monotonic_ns=lambda: now[0], sleep=sleep)
    monkeypatch.setattr("collectors.teleop.clock.time", fake)
    clock = Clock()
    for work in (0, 10, 20, 170, 0, 30):  # [ms]
        now[0] += work * 10**6
        clock.wait()
    beats = clock.beats_ns(6)
    assert (beats / 1e6).tolist() == [0, 50, 100, 270, 320, 370]
    assert steadiness(beats)["late"] == 1
    assert steadiness(beats[:3])["jitter_ms"]["max"] == 0
    assert steadiness(beats[:1]) == {}


def test_contact_begins_at_more_than_it_ends():
    force = [np.array([0, 0, f, 0, 0, 0.0]) for f in (4, 6, 4, 2, 4)]
    contact, seen = False, []
    for wrench in force:
        contact = in_contact(contact, wrench)
        seen.append(contact)
    assert seen == [False, True, True, False, False]


def test_the_middle_of_the_workspace_is_the_middle_of_the_picture():
    assert pixel(FRONT, np.array([0.55, 0.0, 0.0])) == pytest.approx([37.5, 37.5])
    assert pixel(FRONT, np.array([2.0, 0.0, 1.5])) is None  # behind the camera


def test_the_device_of_the_documentation_works():
    page = (Path(__file__).parents[3] / "docs" / "teleoperation.md").read_text()
    names: dict = {}
    for block in re.findall(r"^```python\n(.*?)^```", page, re.M | re.S):
        exec(block, names)
    assert names["Pedal"](SimpleNamespace(value=lambda: 0.5)).read().tolist() == [1, 0, 0, -0.5, 0]
    with pytest.raises(DeviceLostError):
        names["Pedal"](SimpleNamespace(value=Path("/nonexistent").read_text)).read()
