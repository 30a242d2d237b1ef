"""Devices with which a person controls the gripper: keyboard, gamepad, SpaceMouse, and a recorded script."""
