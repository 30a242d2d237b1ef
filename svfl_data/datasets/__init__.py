"""Datasets: folders of episodes, the list of these episodes, and what the episodes have in common."""
