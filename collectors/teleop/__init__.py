"""Teleoperation by a person: input devices, the window, and the session that records what the person does."""
