"""pygame, which draws the window and hears keys and gamepads, without its greeting."""

import os

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
import pygame

__all__ = ["pygame"]
