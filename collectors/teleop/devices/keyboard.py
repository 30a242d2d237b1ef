"""Keyboard of the window as a device."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.teleop.devices.device import FINE, Device, reading
from collectors.teleop.devices.sdl import pygame

# Keys are named by place, not by letter: on every layout the four keys lie in a cross.
MOTIONS = {
    pygame.KSCAN_D: (0, 1), pygame.KSCAN_A: (0, -1),
    pygame.KSCAN_W: (1, 1), pygame.KSCAN_S: (1, -1),
    pygame.KSCAN_E: (2, 1), pygame.KSCAN_Q: (2, -1),
    pygame.KSCAN_LEFT: (3, 1), pygame.KSCAN_RIGHT: (3, -1),
}  # fmt: skip
"""Component of the motion (right, away, up, turn) for each key, and its sign."""
GRIPPER = pygame.KSCAN_SPACE
SLOW = (pygame.KSCAN_LSHIFT, pygame.KSCAN_RSHIFT)


class Keyboard(Device):
    """Keyboard whose keys move the gripper while they are held.

    A key that is tapped between two actions moves the gripper for one action.
    """

    name = "keyboard"
    controls = (
        ("W A S D", "away, left, near, right"),
        ("E Q", "up, down"),
        ("arrows", "turn left, right"),
        ("space", "open or close the gripper"),
        ("shift", "fine: a quarter of the pace"),
    )

    def __init__(self) -> None:
        self._held: set[int] = set()
        self._tapped: set[int] = set()
        self._open = True

    def handle(self, event: Any) -> None:  # noqa: ANN401
        """Keep track of the keys that are held, and of the gripper."""
        if event.type == pygame.KEYDOWN:
            self._held.add(event.scancode)
            self._tapped.add(event.scancode)
            if event.scancode == GRIPPER:
                self._open = not self._open
        elif event.type == pygame.KEYUP:
            self._held.discard(event.scancode)
        elif event.type == pygame.WINDOWFOCUSLOST:
            self._held.clear()  # the release would go to another window, and the gripper would not stop

    def read(self) -> NDArray[np.float32]:
        """Return the reading, (5,), from the keys that are held or were tapped since the last call."""
        keys = self._held | self._tapped
        self._tapped.clear()
        pace = FINE if keys.intersection(SLOW) else 1.0
        motion = np.zeros(4)
        for key in keys & MOTIONS.keys():
            component, sign = MOTIONS[key]
            motion[component] += sign * pace
        return reading(float(self._open), *motion)

    def begin(self, opened: bool) -> None:
        """Take over the state of the gripper at the start of an episode."""
        self._open = opened
