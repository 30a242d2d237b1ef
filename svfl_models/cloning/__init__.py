"""Behaviour cloning: a policy that learns to do what demonstrations do, and how often it then succeeds."""
