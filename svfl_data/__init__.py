"""The episode file: what an episode is, and how to write, read and look at it."""
