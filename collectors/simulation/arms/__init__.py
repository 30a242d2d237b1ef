"""Simulated arms: kinematics, joint servo, the Panda."""
