"""Content of the screen: camera picture, state, bars of force and torque, gripper, and keys."""

import math
from collections.abc import Sequence

import numpy as np

from collectors.teleop.devices.device import Command
from collectors.teleop.devices.sdl import pygame
from collectors.teleop.picture import AXES, GRIPPER, Color, draw_picture
from collectors.teleop.view import CONTACT_N, View

SIZE = (1080, 720)
PICTURE = pygame.Rect(20, 60, 600, 600)
LEFT, RIGHT = 648, 1060  # [px] left and right edge of the column beside the picture
FORCE_N, TORQUE_NM = 20.0, 2.0  # [N] and [N m] at the ends of the bars

GROUND: Color = (24, 28, 36)
TRACK: Color = (44, 50, 62)
TEXT: Color = (232, 236, 242)
FAINT: Color = (148, 158, 174)
RECORDING: Color = (230, 72, 72)
READY: Color = (84, 190, 120)
BLUE = (104, 150, 255)
COLORS = (*AXES.values(), BLUE)

COMMANDS = (
    ("enter", Command.START, "start"),
    ("M", Command.SUCCESS, "mark success, save"),
    ("X", Command.STOP, "stop, save as no success"),
    ("backspace", Command.DISCARD, "discard"),
    ("R", Command.AGAIN, "record the last one again"),
    ("T", Command.TARE, "tare: hold the gripper free"),
    ("escape", Command.QUIT, "save and quit"),
)
"""Key, the command it gives, and the meaning that is shown for it."""


class Panel:
    """Panel that draws views for one device.

    Args:
        device: Name of the device.
        controls: Controls of the device, and their meanings.
    """

    def __init__(self, device: str, controls: Sequence[tuple[str, str]]) -> None:
        pygame.font.init()
        self._large, self._font, self._small = (pygame.font.Font(None, size) for size in (34, 24, 21))
        self._device, self._controls = device, controls

    def draw(self, target: pygame.Surface, view: View) -> None:
        """Draw a view on a surface of `SIZE`.

        Args:
            target: Surface to draw on.
            view: View to draw.
        """
        target.fill(GROUND)
        self._write(target, self._large, view.task.replace("_", " "), TEXT, (20, 20))
        self._state(target, view)
        draw_picture(target, PICTURE, view, self._font)
        border = RECORDING if view.seconds is not None else TRACK
        pygame.draw.rect(target, GRIPPER if view.contact else border, PICTURE.inflate(6, 6), 3, border_radius=4)
        self._write(target, self._font, view.message, TEXT, (20, 672))
        counts = f"saved {view.saved}, of which {view.succeeded} succeeded"
        self._write(target, self._small, f"{counts}      {view.pace}", FAINT, (20, 697))
        if view.wrench is None:
            self._write(target, self._font, "This robot has no wrench sensor", FAINT, (LEFT, 74))
        else:
            self._wrench(target, view.wrench, view.contact)
        if view.observation.proprio is not None:
            self._gripper(target, view.observation.proprio)
        self._keys(target)

    def _wrench(self, target: pygame.Surface, wrench: np.ndarray, contact: bool) -> None:
        """Draw force and torque as bars, and whether the gripper is in contact."""
        force, torque = np.split(wrench, 2)
        self._lamp(target, contact, float(np.linalg.norm(force)))
        self._bars(target, 98, ("fx", "fy", "fz"), force, FORCE_N, "N", 1)
        self._write(target, self._font, "Torque", TEXT, (LEFT, 186))
        self._write(target, self._small, f"full bar {TORQUE_NM:g} N m", FAINT, (RIGHT, 188), right=True)
        self._bars(target, 210, ("mx", "my", "mz"), torque, TORQUE_NM, "N m", 2)

    def _write(
        self, target: pygame.Surface, font: pygame.font.Font, text: str, color: Color, at: tuple[int, int],
        right: bool = False,
    ) -> None:  # fmt: skip
        word = font.render(text, True, color)
        target.blit(word, (at[0] - word.get_width() if right else at[0], at[1]))

    def _state(self, target: pygame.Surface, view: View) -> None:
        """Draw whether an episode is being recorded, at the upper right corner of the picture."""
        running = view.seconds is not None
        words = f"RECORDING  {view.seconds:.1f} s" if view.seconds is not None else "READY, enter starts"
        word = self._font.render(f"episode {view.episode}   {words}", True, GROUND)
        pill = word.get_rect(midright=(PICTURE.right - 12, 34)).inflate(24, 14)
        pygame.draw.rect(target, RECORDING if running else READY, pill, border_radius=pill.height // 2)
        target.blit(word, word.get_rect(center=pill.center))

    def _lamp(self, target: pygame.Surface, contact: bool, newtons: float) -> None:
        self._write(target, self._font, f"Force  {newtons:.1f} N", TEXT, (LEFT, 74))
        self._write(target, self._small, f"full bar {FORCE_N:g} N", FAINT, (RIGHT, 76), right=True)
        if contact:
            word = self._font.render("CONTACT", True, GROUND)
            pill = word.get_rect(midright=(RIGHT - 8, 34)).inflate(20, 14)
            pygame.draw.rect(target, GRIPPER, pill, border_radius=pill.height // 2)
            target.blit(word, word.get_rect(center=pill.center))
        else:
            self._write(target, self._small, f"contact from {CONTACT_N:g} N", FAINT, (RIGHT, 28), right=True)

    def _bars(
        self, target: pygame.Surface, top: int, names: Sequence[str], values: np.ndarray, full: float, unit: str,
        digits: int,
    ) -> None:  # fmt: skip
        """Draw bars to both sides of zero; a bar that exceeds the scale ends in a white edge."""
        for row, (name, value, color) in enumerate(zip(names, values, COLORS, strict=True)):
            y = top + 28 * row
            track = pygame.Rect(LEFT + 34, y, 272, 18)
            pygame.draw.rect(target, TRACK, track, border_radius=3)
            share = float(np.clip(value / full, -1.0, 1.0))
            length = round(abs(share) * track.width / 2)
            bar = pygame.Rect(track.centerx - (length if share < 0 else 0), y, length, track.height)
            pygame.draw.rect(target, color, bar)
            if abs(share) == 1.0:
                edge = bar.left if share < 0 else bar.right - 4
                pygame.draw.rect(target, TEXT, (edge, y, 4, track.height))
            pygame.draw.line(target, FAINT, (track.centerx, y - 2), (track.centerx, y + 19))
            self._write(target, self._font, name, color, (LEFT, y + 1))
            shown = round(float(value), digits) + 0.0  # no -0.0
            self._write(target, self._font, f"{shown:+.{digits}f} {unit}", TEXT, (RIGHT, y + 1), right=True)

    def _gripper(self, target: pygame.Surface, proprio: np.ndarray) -> None:
        """Draw the gripper as seen from the front, and its height and rotation."""
        opening, _, _, z, theta = map(float, proprio)
        top, centre = 314, LEFT + 70
        pygame.draw.rect(target, FAINT, (centre - 58, top, 116, 12), border_radius=3)
        gap = round(44 * min(max(opening, 0.0), 1.0))
        for left in (centre - gap - 14, centre + gap):
            pygame.draw.rect(target, GRIPPER, (left, top + 14, 14, 34), border_radius=2)
        words = "open" if opening > 0.95 else "closed" if opening < 0.02 else f"{opening:.0%} open"
        x = LEFT + 160
        for row, (name, value) in enumerate(
            (("gripper", words), ("height", f"{1e3 * z:.0f} mm"), ("turned", f"{round(math.degrees(theta)):+d} deg"))
        ):
            self._write(target, self._font, name, FAINT, (x, top - 4 + 23 * row))
            self._write(target, self._font, value, TEXT, (RIGHT, top - 4 + 23 * row), right=True)

    def _keys(self, target: pygame.Surface) -> None:
        """Draw the device's controls, then the keys that work with every device."""
        y = 392
        keys = [(key, meaning) for key, _, meaning in COMMANDS]
        tables = ((self._device, self._controls), ("keys", keys))
        pitch = min(21, (SIZE[1] - y - 64) // (len(keys) + len(self._controls)))
        for title, rows in tables:
            self._write(target, self._small, title, FAINT, (LEFT, y))
            pygame.draw.line(target, TRACK, (LEFT, y + 19), (RIGHT, y + 19))
            y += 24
            for control, meaning in rows:
                self._write(target, self._font, control, GRIPPER, (LEFT, y))
                self._write(target, self._font, meaning, TEXT, (LEFT + 140, y))
                y += pitch
            y += 10
