"""Window on the desktop that shows views, and reads the keys that are the same for every device."""

import os
import sys
from typing import Any

from collectors.teleop.devices.device import Command, Device
from collectors.teleop.devices.sdl import pygame
from collectors.teleop.panel import COMMANDS, SIZE, Panel
from collectors.teleop.view import View
from svfl_data.errors import CollectError

TITLE = "SVFL teleoperation"
SDL_NAMES = {"enter": "return"}
"""SDL's names of keys that differ from the labels on the keys."""
LATIN = 0x24F
"""Code of the last Latin letter in Unicode.

Keys of a layout in another script have codes above it, so their commands are taken from their positions."""


class Window:
    """Screen (`collectors.teleop.screen.Screen`) on the desktop.

    Devices that receive their events through pygame work only while the window is open.

    Raises:
        CollectError: If there is no display to open the window on.
    """

    def __init__(self) -> None:
        asked = os.environ.get("SDL_VIDEODRIVER")
        displays = os.environ.get("DISPLAY"), os.environ.get("WAYLAND_DISPLAY")
        if sys.platform == "linux" and not asked and not any(displays):
            raise _no_display("neither DISPLAY nor WAYLAND_DISPLAY is set")
        try:
            pygame.display.init()
            if not asked and pygame.display.get_driver() == "offscreen":  # where SDL draws if nothing else is left
                raise pygame.error("the display does not answer")
            pygame.display.set_caption(TITLE)
            self._window = pygame.display.set_mode(SIZE, pygame.RESIZABLE)
        except pygame.error as error:
            pygame.display.quit()
            raise _no_display(str(error)) from error
        self._canvas = pygame.Surface(SIZE)
        self._keys = {pygame.key.key_code(SDL_NAMES.get(key, key)): command for key, command, _ in COMMANDS}
        self._places = {getattr(pygame, f"KSCAN_{key}"): command for key, command, _ in COMMANDS if len(key) == 1}

    def present(self, device: Device) -> None:
        """Show the controls of a device until the next call."""
        self._panel = Panel(device.name, device.controls)

    def poll(self) -> tuple[list[Any], list[Command]]:
        """Return all events since the last call, and the commands that they give."""
        events = pygame.event.get()
        commands = []
        for event in events:
            if event.type == pygame.QUIT:
                commands.append(Command.QUIT)
            elif event.type == pygame.KEYDOWN and event.key in self._keys:
                commands.append(self._keys[event.key])
            elif event.type == pygame.KEYDOWN and event.key > LATIN and event.scancode in self._places:
                commands.append(self._places[event.scancode])
        return events, commands

    def show(self, view: View) -> None:
        """Draw a view and show it."""
        self._panel.draw(self._canvas, view)
        whole = self._canvas.get_rect().fit(self._window.get_rect())  # the person may have resized it
        self._window.fill(0)
        shown = self._canvas if whole.size == SIZE else pygame.transform.smoothscale(self._canvas, whole.size)
        self._window.blit(shown, whole)
        pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        pygame.display.quit()


def _no_display(why: str) -> CollectError:
    return CollectError(
        f"no display to open the window on ({why}); without one, --input-device script FILE replays an input log"
    )
