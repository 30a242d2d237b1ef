"""What a person steers with: keyboard, gamepad, SpaceMouse, a recorded script."""
