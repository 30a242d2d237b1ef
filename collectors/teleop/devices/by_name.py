"""Devices by name; a new device needs its own file and a line here."""

from collections.abc import Callable, Sequence
from pathlib import Path

from collectors.teleop.devices.device import Device
from svfl_data.errors import UsageError
from svfl_data.system.near_names import instead


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
    """Check the words that were given after ``--input-device``.

    Args:
        words: Name of the device, followed by one file if the device is a script.

    Raises:
        UsageError: If there is no such device, a script has not exactly one file, or another device has one.
    """
    name, *files = words
    if name != SCRIPT and name not in DEVICES:
        raise UsageError(f"--input-device: no device {name!r}; {instead(name, [*DEVICES, 'script FILE'])}")
    if len(files) != (name == SCRIPT):
        raise UsageError(f"--input-device {' '.join(words)}: script takes one FILE, the others take none")


def open_device(words: Sequence[str]) -> Device:
    """Open the device whose words `check_device` has accepted.

    A window must be open already, except for a script.

    Args:
        words: Name of the device, followed by one file if the device is a script.

    Raises:
        CollectError: If the device is not connected, or a library that it needs is not installed.
        FormatError: If the file of a script is not an input log.
    """
    from collectors.teleop.devices.script import Script

    return Script(Path(words[1])) if words[0] == SCRIPT else DEVICES[words[0]]()
