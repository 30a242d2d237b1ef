"""A gamepad, as SDL knows most of them: the same controls at the same places, whoever made it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.teleop.devices.device import FINE, Command, Device, DeviceLostError, reading, without_rest
from collectors.teleop.devices.sdl import pygame
from svfl_data.errors import CollectError

REST = 0.15  # of a stick's range: worn sticks do not come back to 0
AXIS = 32768.0
STRONGEST = 30.0  # [N] of a contact that is felt with full strength
CUE_MS = 150
COMMANDS = {
    pygame.CONTROLLER_BUTTON_START: Command.START,
    pygame.CONTROLLER_BUTTON_Y: Command.SUCCESS,
    pygame.CONTROLLER_BUTTON_X: Command.STOP,
    pygame.CONTROLLER_BUTTON_B: Command.DISCARD,
    pygame.CONTROLLER_BUTTON_BACK: Command.AGAIN,
    pygame.CONTROLLER_BUTTON_RIGHTSTICK: Command.TARE,
}


class Gamepad(Device):
    """The first gamepad that is connected.

    Raises:
        CollectError: If there is none.
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
        # Experimental by pygame's word, yet the only way to SDL's table of where each make has its controls.
        from pygame._sdl2 import controller

        controller.init()
        pygame.joystick.init()
        count = pygame.joystick.get_count()
        known = [number for number in range(count) if controller.is_controller(number)]
        if not known:
            others = [pygame.joystick.Joystick(number).get_name() for number in range(count)]
            found = f"only {', '.join(others)}, which SDL has no mapping for" if others else "no joystick of any kind"
            raise CollectError(f"--device gamepad: no gamepad is connected; found {found}")
        self._controller = controller.Controller(known[0])
        self._open = True
        self._told: list[Command] = []

    def handle(self, event: Any) -> None:  # noqa: ANN401
        """Buttons; sticks are read where they are."""
        if event.type != pygame.CONTROLLERBUTTONDOWN:
            return
        if event.button == pygame.CONTROLLER_BUTTON_A:
            self._open = not self._open
        elif event.button in COMMANDS:
            self._told.append(COMMANDS[event.button])

    def commands(self) -> list[Command]:
        """What its buttons told."""
        told, self._told = self._told, []
        return told

    def read(self) -> NDArray[np.float32]:
        """Where sticks and triggers are."""
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
        """The gripper is where the episode has it."""
        self._open = opened

    def touch(self, newtons: float) -> None:
        """Rumble, the stronger the harder the contact."""
        strength = min(1.0, 0.3 + 0.7 * newtons / STRONGEST)
        self._controller.rumble(strength, strength, CUE_MS)  # says False where there is no motor

    def close(self) -> None:
        """Let go of it."""
        self._controller.quit()
