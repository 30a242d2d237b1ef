"""The devices by name. Adding one means its file and a line here."""

from collections.abc import Callable, Sequence
from pathlib import Path

from collectors.teleop.devices.device import Device
from svfl_data.errors import UsageError


def _keyboard() -> Device:
    from collectors.teleop.devices.keyboard import Keyboard

    return Keyboard()


def _gamepad() -> Device:
    from collectors.teleop.devices.gamepad import Gamepad

    return Gamepad()


def _spacemouse() -> Device:
    from collectors.teleop.devices.spacemouse import SpaceMouse

    return SpaceMouse.find()


DEVICES: dict[str, Callable[[], Device]] = {"keyboard": _keyboard, "gamepad": _gamepad, "spacemouse": _spacemouse}
SCRIPT = "script"


def check_device(words: Sequence[str]) -> None:
    """Check what was said after ``--device``.

    Raises:
        UsageError: If there is no such device, or the script has not one file.
    """
    name, *files = words
    if name != SCRIPT and name not in DEVICES:
        raise UsageError(f"--device: no device {name!r}; the devices are {', '.join(DEVICES)}, script FILE")
    if len(files) != (name == SCRIPT):
        raise UsageError(f"--device {' '.join(words)}: script takes one FILE, the others take none")


def open_device(words: Sequence[str]) -> Device:
    """Open what `check_device` found in order; a window must be open already, except for a script.

    Raises:
        CollectError: If it is not connected, or what it needs is not installed.
        FormatError: If the script is not one.
    """
    from collectors.teleop.devices.script import Script

    return Script(Path(words[1])) if words[0] == SCRIPT else DEVICES[words[0]]()
