"""Screen that shows a person the state of the session, and gives the person's commands."""

from typing import Any, Protocol

from collectors.teleop.devices.device import Command, Device
from collectors.teleop.view import View


class Screen(Protocol):
    """Screen that shows views, and returns events and commands."""

    def present(self, device: Device) -> None:
        """Show the controls of a device until the next call."""

    def poll(self) -> tuple[list[Any], list[Command]]:
        """Return the events for the device, and the commands, since the last call."""

    def show(self, view: View) -> None:
        """Show a view of the current state."""

    def close(self) -> None:
        """Close the screen."""


class NoScreen:
    """Screen for scripts, which shows nothing and gives no commands."""

    def present(self, device: Device) -> None:
        """Show nothing."""

    def poll(self) -> tuple[list[Any], list[Command]]:
        """Return no events and no commands."""
        return [], []

    def show(self, view: View) -> None:
        """Show nothing."""

    def close(self) -> None:
        """Do nothing, since nothing was opened."""
