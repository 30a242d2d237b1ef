"""Gamepad as read through SDL, which gives the controls of most makes the same names by their places."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.teleop.devices.device import FINE, Command, Device, DeviceLostError, reading, without_rest
from collectors.teleop.devices.sdl import pygame
from svfl_data.errors import CollectError

REST = 0.15  # fraction of a stick's range that counts as rest, since worn sticks do not come back to 0
AXIS = 32768.0  # value of an axis at full deflection
STRONGEST = 30.0  # [N] of a contact at which the gamepad rumbles with full strength
CUE_MS = 150  # [ms] that the gamepad rumbles at a contact
COMMANDS = {
    pygame.CONTROLLER_BUTTON_START: Command.START,
    pygame.CONTROLLER_BUTTON_Y: Command.SUCCESS,
    pygame.CONTROLLER_BUTTON_X: Command.STOP,
    pygame.CONTROLLER_BUTTON_B: Command.DISCARD,
    pygame.CONTROLLER_BUTTON_BACK: Command.AGAIN,
    pygame.CONTROLLER_BUTTON_RIGHTSTICK: Command.TARE,
}


class Gamepad(Device):
    """First gamepad that is connected.

    Raises:
        CollectError: If no gamepad is connected.
    """

    name = "gamepad"
    controls = (
        ("left stick", "left, right, away, near"),
        ("triggers", "right up, left down"),
        ("right stick", "turn"),
        ("A", "open or close the gripper"),
        ("left shoulder", "fine: a quarter of the pace"),
        ("start  Y  X  B", "start, success, stop, discard"),
        ("back", "record the last one again"),
    )

    def __init__(self) -> None:
        # This module is experimental according to pygame, but only it reads SDL's table of each make's controls.
        from pygame._sdl2 import controller

        controller.init()
        pygame.joystick.init()
        count = pygame.joystick.get_count()
        known = [number for number in range(count) if controller.is_controller(number)]
        if not known:
            others = [pygame.joystick.Joystick(number).get_name() for number in range(count)]
            found = f"only {', '.join(others)}, which SDL has no mapping for" if others else "no joystick of any kind"
            raise CollectError(f"--input-device gamepad: no gamepad is connected; found {found}")
        self._controller = controller.Controller(known[0])
        self._open = True
        self._told: list[Command] = []

    def handle(self, event: Any) -> None:  # noqa: ANN401
        """Handle the press of a button; sticks and triggers are read in `read`."""
        if event.type != pygame.CONTROLLERBUTTONDOWN:
            return
        if event.button == pygame.CONTROLLER_BUTTON_A:
            self._open = not self._open
        elif event.button in COMMANDS:
            self._told.append(COMMANDS[event.button])

    def commands(self) -> list[Command]:
        """Return the commands that the buttons have given since the last call."""
        told, self._told = self._told, []
        return told

    def read(self) -> NDArray[np.float32]:
        """Return the state of sticks and triggers as a reading, (5,)."""
        if not self._controller.attached():
            raise DeviceLostError("the gamepad was unplugged")
        pace = FINE if self._controller.get_button(pygame.CONTROLLER_BUTTON_LEFTSHOULDER) else 1.0
        lift = self._axis(pygame.CONTROLLER_AXIS_TRIGGERRIGHT) - self._axis(pygame.CONTROLLER_AXIS_TRIGGERLEFT)
        motion = (  # SDL's vertical axes point down
            self._axis(pygame.CONTROLLER_AXIS_LEFTX),
            -self._axis(pygame.CONTROLLER_AXIS_LEFTY),
            lift,
            -self._axis(pygame.CONTROLLER_AXIS_RIGHTX),
        )
        return reading(float(self._open), *(pace * value for value in motion))

    def _axis(self, axis: int) -> float:
        return without_rest(max(-1.0, self._controller.get_axis(axis) / AXIS), REST)

    def begin(self, opened: bool) -> None:
        """Take over the state of the gripper at the start of an episode."""
        self._open = opened

    def touch(self, newtons: float) -> None:
        """Rumble, more strongly for a harder contact."""
        strength = min(1.0, 0.3 + 0.7 * newtons / STRONGEST)
        self._controller.rumble(strength, strength, CUE_MS)  # returns False where there is no motor

    def close(self) -> None:
        """Release the gamepad."""
        self._controller.quit()
