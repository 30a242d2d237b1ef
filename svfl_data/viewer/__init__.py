"""Display of episodes in Rerun's viewer, or in a file that it opens; importing this package does not import Rerun."""
