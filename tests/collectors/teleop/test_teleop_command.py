"""``svfl-collect teleop`` where something is missing: one line that says what, and exit code 1 or 2."""

import re
import sys

import pytest

from collectors.cli import main

TASK = ("teleop", "--task", "block_picking", "--input-device")


@pytest.fixture
def answer(monkeypatch, capsys, tmp_path):
    """Runs the command in this process; gives its exit code and the one line of complaint."""

    def run(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["svfl-collect", *TASK, *words, "--out", str(tmp_path / "mine")])
        code = main()
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        assert not (tmp_path / "mine").exists()
        return code, line

    return run


@pytest.mark.parametrize(
    ("words", "facts"),
    [
        (["joystick"], "'joystick'.* keyboard, gamepad, spacemouse, script FILE"),
        (["script"], "script .*FILE"),
        (["keyboard", "fast"], "the others take none"),
    ],
)
def test_a_device_that_does_not_exist(answer, words, facts):
    code, line = answer(*words)
    assert code == 2
    assert re.search(facts, line)


def test_no_log_to_replay(answer, tmp_path):
    code, line = answer("script", str(tmp_path / "absent.log"))
    assert code == 1
    assert "absent.log" in line


def test_no_viewer_is_said_before_a_window_opens(answer):
    code, line = answer("keyboard", "--rerun", "127.0.0.1:9")
    assert code == 2
    assert "--rerun 127.0.0.1:9" in line


@pytest.mark.parametrize("display", [None, ":987"])  # none, and one that does not answer
def test_no_display(answer, monkeypatch, display):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    code, line = answer("keyboard")
    assert code == 1
    assert "display" in line
    assert "--input-device script FILE" in line


@pytest.mark.parametrize(("library", "device"), [("pygame", "keyboard"), ("hid", "spacemouse")])
def test_a_library_that_is_not_installed_is_named_with_its_extra(answer, monkeypatch, library, device):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    if library == "pygame":
        for module in ("sdl", "picture", "panel", "window"):
            monkeypatch.delitem(sys.modules, f"collectors.teleop.{module}", raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    code, line = answer(device)
    assert code == 1
    assert library in line
    assert line.endswith("pip install 'svfl[teleop]'\n")


def test_no_gamepad(answer, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    code, line = answer("gamepad")
    assert code == 1
    assert re.search("gamepad.* found no joystick", line)
