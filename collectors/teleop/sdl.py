"""pygame, which draws the window and hears keys and gamepads, without its greeting."""

import os

from svfl_data.errors import CollectError

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
try:
    import pygame
except ModuleNotFoundError as error:
    raise CollectError("pygame-ce is not installed here; run: pip install 'svfl[teleop]'") from error

__all__ = ["pygame"]
