"""Picture of the camera, with drawings that help a person to estimate depth."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.teleop.devices.sdl import pygame
from collectors.teleop.view import View, pixel

Color = tuple[int, int, int]

GRIPPER: Color = (255, 214, 64)
FLOOR: Color = (235, 238, 242)
AXES = {"x": (240, 96, 96), "y": (96, 205, 110)}
HALF_STROKE = 0.04  # [m] from the TCP to an open finger of a common gripper; only used for the drawing


def draw_picture(target: pygame.Surface, place: pygame.Rect, view: View, font: pygame.font.Font) -> None:
    """Draw the enlarged picture of the camera, with the workspace, the TCP and the point on the table below it.

    What the robot does not tell is not drawn.

    Args:
        target: Surface to draw on.
        place: Square of the surface for the picture.
        view: View to draw.
        font: Font for the names of the axes.
    """
    if view.camera is None or view.camera not in view.observation.frames:
        word = font.render("no picture", True, FLOOR)
        target.blit(word, word.get_rect(center=place.center))
        return
    color = view.observation.frames[view.camera].color
    height, width = color.shape[:2]
    scale = min(place.width / width, place.height / height)
    size = round(scale * width), round(scale * height)
    large = cv2.resize(color, size, interpolation=cv2.INTER_LINEAR)  # pygame's own scaling shifts by up to a pixel
    whole = pygame.image.frombytes(large.tobytes(), size, "RGB")
    corner = np.array(whole.get_rect(center=place.center).topleft)
    target.blit(whole, corner)
    calibration = view.calibration
    if calibration is None:
        return
    target.set_clip(place)

    def at(*point: float) -> tuple[float, float] | None:
        seen = pixel(calibration, np.array(point))
        return None if seen is None else tuple((seen + 0.5) * scale + corner)

    def line(color: Color, start: tuple[float, float] | None, end: tuple[float, float] | None, width: int = 1) -> None:
        if start and end:
            pygame.draw.line(target, color, start, end, width)

    if view.workspace is not None:
        (x0, x1), (y0, y1), _ = view.workspace
        edge = [at(x, y, 0.0) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
        for start, end in zip(edge, edge[1:] + edge[:1], strict=True):
            line(FLOOR, start, end)
    if view.observation.proprio is not None:
        _draw_gripper(at, line, view.observation.proprio)
        foot = at(float(view.observation.proprio[1]), float(view.observation.proprio[2]), 0.0)
        if foot:
            pygame.draw.circle(target, GRIPPER, foot, 6, 2)
    _draw_axes(target, place, calibration.image_axes, font)
    target.set_clip(None)


def _draw_gripper(at, line, proprio: NDArray[np.float32]) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    """Draw the axis along which the fingers open, and the vertical line from the TCP to the table."""
    opening, x, y, z, theta = map(float, proprio)
    line(GRIPPER, at(x, y, z), at(x, y, 0.0), 2)
    reach = HALF_STROKE * opening
    dx, dy = -math.sin(theta), math.cos(theta)
    for height in (z, 0.0):
        line(GRIPPER, at(x - reach * dx, y - reach * dy, height), at(x + reach * dx, y + reach * dy, height), 2)


def _draw_axes(
    target: pygame.Surface, place: pygame.Rect, image_axes: NDArray[np.float64], font: pygame.font.Font
) -> None:
    """Draw base x and y as the picture shows them, in its lower left corner, to explain the names of the forces."""
    origin = np.array([place.left + 52, place.bottom - 52])
    backdrop = pygame.Surface((92, 92), pygame.SRCALPHA)
    pygame.draw.circle(backdrop, (15, 18, 24, 150), (46, 46), 46)
    target.blit(backdrop, origin - 46)
    for (name, color), (right, up) in zip(AXES.items(), image_axes.T, strict=True):
        tip = origin + 26 * np.array([right, -up])
        pygame.draw.line(target, color, origin, tip, 3)
        word = font.render(name, True, color)
        target.blit(word, word.get_rect(center=origin + 37 * np.array([right, -up])))
