"""Where collectors run: worker processes of this machine, or a Ray cluster. What is collected does not depend on it."""
