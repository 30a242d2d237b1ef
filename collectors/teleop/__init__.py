"""A person at work: devices, the window, and the session that records what they do."""
