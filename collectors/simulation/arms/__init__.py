"""Simulated arms: the kinematics, the joint servo and the Panda."""
