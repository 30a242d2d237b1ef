"""Where a person sees what happens, and tells what shall happen."""

from typing import Any, Protocol

from collectors.teleop.devices.device import Command, Device
from collectors.teleop.view import View


class Screen(Protocol):
    """Shows views, and hears events and commands."""

    def present(self, device: Device) -> None:
        """Show the controls of this device from now on."""

    def poll(self) -> tuple[list[Any], list[Command]]:
        """Events for the device, and commands, since the last time."""

    def show(self, view: View) -> None:
        """Show what there is now."""

    def close(self) -> None:
        """No more."""


class NoScreen:
    """For scripts: there is nobody to look or to tell."""

    def present(self, device: Device) -> None:
        """Nothing is shown."""

    def poll(self) -> tuple[list[Any], list[Command]]:
        """Nothing is heard."""
        return [], []

    def show(self, view: View) -> None:
        """Nothing is shown."""

    def close(self) -> None:
        """Nothing was open."""
