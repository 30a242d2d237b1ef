"""Training in several processes of this machine, which share every batch and give the result of one process."""
