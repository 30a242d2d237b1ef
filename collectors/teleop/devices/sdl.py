"""Import of pygame, which draws the window and reads keys and gamepads, without the greeting that it prints."""

import os

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
import pygame

__all__ = ["pygame"]
