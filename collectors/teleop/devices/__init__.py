"""Devices that a person steers with: keyboard, gamepad, SpaceMouse, and a recorded script."""
