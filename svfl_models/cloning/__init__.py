"""Behaviour cloning: training of policies from demonstrations, and measurement of their success."""
