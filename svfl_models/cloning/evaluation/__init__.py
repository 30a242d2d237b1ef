"""Evaluation of trained policies without a simulator, and in environments of other packages."""
