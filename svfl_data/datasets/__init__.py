"""A folder of episodes: which there are, and what they have in common."""
